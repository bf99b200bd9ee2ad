// Pinocchio's C++ as a peer: inverse dynamics and regressor of many states, one thread. Built by `peers.py` against the
// headers of the wheel `pin`; prints one line of JSON with nanoseconds per call.
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <random>
#include <vector>

#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody/sample-models.hpp>

// Of the processor: other people's jobs do not count.
double now_ns()
{
    timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return 1e9 * time.tv_sec + time.tv_nsec;
}

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

int main()
{
    // Its own six-axis arm: the wheel has no URDF headers, and time does not depend on the numbers.
    pinocchio::Model model;
    pinocchio::buildModels::manipulator(model);
    pinocchio::Data data(model);
    const int n = 4096;
    std::mt19937_64 random(0);
    std::uniform_real_distribution<double> uniform(-2.0, 2.0);
    std::vector<Eigen::VectorXd> q, v, a;
    for (int k = 0; k < n; ++k) {
        for (auto *states : {&q, &v, &a}) {
            Eigen::VectorXd state(model.nv);
            for (int j = 0; j < model.nv; ++j)
                state[j] = uniform(random);
            states->push_back(state);
        }
    }
    double sum = 0.0;
    double rnea = median_ns(7, n, [&](int k) { sum += pinocchio::rnea(model, data, q[k], v[k], a[k])[0]; });
    double regressor = median_ns(7, n, [&](int k) {
        sum += pinocchio::computeJointTorqueRegressor(model, data, q[k], v[k], a[k])(0, 0);
    });
    std::printf("{\"rnea_ns\": %.1f, \"regressor_ns\": %.1f, \"checksum\": %.3e}\n", rnea, regressor, sum);
}
