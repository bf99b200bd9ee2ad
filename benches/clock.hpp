// How the C++ peers take the time.
#pragma once

#include <algorithm>
#include <ctime>
#include <vector>

// Of the processor: other people's jobs do not count.
inline double now_ns()
{
    timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return 1e9 * time.tv_sec + time.tv_nsec;
}

// Nanoseconds per call, the median over rounds of n calls.
template <class Work> double median_ns(int rounds, int n, Work work)
{
    std::vector<double> times;
    for (int round = 0; round < rounds; ++round) {
        double start = now_ns();
        for (int k = 0; k < n; ++k)
            work(k);
        times.push_back((now_ns() - start) / n);
    }
    std::sort(times.begin(), times.end());
    return times[rounds / 2];
}
