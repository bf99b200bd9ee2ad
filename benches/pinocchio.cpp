// Pinocchio's C++ as a peer: inverse dynamics and regressor of many states, one thread. Built by `native.py` against the
// headers of the wheel `pin`; prints one line of JSON with nanoseconds per call.
#include <cstdio>
#include <random>
#include <vector>

#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody/sample-models.hpp>

#include "clock.hpp"

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
