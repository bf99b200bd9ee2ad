// What estimate.c does, in C++17 with handles that free themselves.
//
//   c++ -std=c++17 -I rust/dynid-c -I examples/c examples/c/estimate.cpp -L target/release -l:libdynid.a
//       -lm -lpthread -ldl -o estimate_cpp
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <iterator>
#include <vector>

#include "dynid.hpp"

namespace {

void print(const std::vector<double> &values) {
    for (double value : values) {
        std::printf("%.17g ", value);
    }
}

int run(const char *path, std::size_t n_signals) {
    std::ifstream file(path, std::ios::binary);
    const auto model = file ? dynid::Model::parse({std::istreambuf_iterator<char>(file), {}}) : dynid::Model::load(path);
    dynid::Estimator estimator(model);
    const std::size_t n = estimator.n_joints();

    std::vector<double> line(n_signals * n), tau(n), terms(estimator.n_terms() * n), std_dev(n);
    DynidState state{line.data(), line.data() + n, line.data() + 2 * n, nullptr, nullptr, nullptr, nullptr};
    if (n_signals >= 6) {
        state.q_motor = line.data() + 3 * n;
        state.dq_motor = line.data() + 4 * n;
        state.ddq_motor = line.data() + 5 * n;
    }
    if (n_signals == 7) {
        state.temperature = line.data() + 6 * n;
    }

    std::size_t read = 0;
    while (std::scanf("%lf", &line[read]) == 1) {
        if (++read < line.size()) {
            continue;
        }
        read = 0;
        const std::uint32_t status = estimator.estimate(state, tau);
        estimator.terms(terms);
        estimator.predicted_std(std_dev);
        print(tau);
        print(terms);
        print(std_dev);
        std::printf("%u\n", static_cast<unsigned>(status));
    }
    if (read != 0 || !std::feof(stdin)) {
        throw std::runtime_error("the input ends in the middle of a state, or holds something that is no number");
    }
    return 0;
}

}  // namespace

int main(int argc, char **argv) {
    const long n_signals = argc == 3 ? std::strtol(argv[2], nullptr, 10) : 0;
    if (n_signals != 3 && n_signals != 6 && n_signals != 7) {
        std::fputs("usage: estimate_cpp MODEL.json 3|6|7 < states.txt\n", stderr);
        return 2;
    }
    try {
        return run(argv[1], static_cast<std::size_t>(n_signals));
    } catch (const std::exception &error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return 2;
    }
}
