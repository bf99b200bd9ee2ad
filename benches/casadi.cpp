// CasADi's C as a peer: the functions of `arm_graph.py`, of many states, one thread. Each state's answer goes where the last
// one went, and the regressor's entries that are always zero are not written. Prints one line of JSON with nanoseconds per call.
#include <cstdio>
#include <random>
#include <vector>

#include "clock.hpp"

extern "C" {
int torques(const double **arguments, double **results, long long *integers, double *numbers, int memory);
int torques_work(long long *arguments, long long *results, long long *integers, long long *numbers);
int regressor(const double **arguments, double **results, long long *integers, double *numbers, int memory);
int regressor_work(long long *arguments, long long *results, long long *integers, long long *numbers);
}

template <class Function, class Work> double nanoseconds(Function function, Work work, const std::vector<double> *motion, double &sum)
{
    long long sizes[4];
    work(&sizes[0], &sizes[1], &sizes[2], &sizes[3]);
    std::vector<const double *> arguments(sizes[0]);
    std::vector<double *> results(sizes[1]);
    std::vector<long long> integers(sizes[2]);
    std::vector<double> numbers(sizes[3]), answer(6 * 60);
    results[0] = answer.data();
    return median_ns(7, motion[0].size() / 6, [&](int k) {
        for (int signal = 0; signal < 3; ++signal)
            arguments[signal] = &motion[signal][6 * k];
        function(arguments.data(), results.data(), integers.data(), numbers.data(), 0);
        sum += answer[0];
    });
}

int main()
{
    std::mt19937_64 random(0);
    std::uniform_real_distribution<double> uniform(-2.0, 2.0);
    std::vector<double> motion[3];
    for (auto &signal : motion)
        for (int k = 0; k < 6 * 4096; ++k)
            signal.push_back(uniform(random));
    double sum = 0.0;
    double rnea = nanoseconds(torques, torques_work, motion, sum);
    double matrix = nanoseconds(regressor, regressor_work, motion, sum);
    std::printf("{\"rnea_ns\": %.1f, \"regressor_ns\": %.1f, \"checksum\": %.3e}\n", rnea, matrix, sum);
}
