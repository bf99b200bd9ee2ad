/*
 * States in on standard input, torques out on standard output, by libdynid.
 *
 *   cargo build --release -p dynid-c
 *   cc -std=c99 -I rust/dynid-c examples/c/estimate.c -L target/release -l:libdynid.a -lm -lpthread -ldl -o estimate
 *   ./estimate result/model.json 6 < states.txt
 *
 * The number says how many signals a line holds, each with one value per joint: 3 for q dq ddq, 6 with q_motor
 * dq_motor ddq_motor as well, 7 with the temperatures ("nan" where one is not known). A line of the answer holds the
 * torques, every term's torques, the predicted standard deviations and the status.
 */
#include <stdio.h>
#include <stdlib.h>

#include "dynid.h"

static void check(DynidCode code)
{
    if (code != DYNID_CODE_OK) {
        fprintf(stderr, "error: %s\n", dynid_last_error());
        exit(2);
    }
}

static double *zeros(size_t n)
{
    double *values = calloc(n, sizeof *values);
    if (values == NULL) {
        fputs("error: out of memory\n", stderr);
        exit(2);
    }
    return values;
}

static void print(const double *values, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        printf("%.17g ", values[i]); /* 17 digits are all of them */
    }
}

int main(int argc, char **argv)
{
    long n_signals = argc == 3 ? strtol(argv[2], NULL, 10) : 0;
    if (n_signals != 3 && n_signals != 6 && n_signals != 7) {
        fputs("usage: estimate MODEL.json 3|6|7 < states.txt\n", stderr);
        return 2;
    }

    DynidModel *model = NULL;
    check(dynid_model_load(argv[1], &model));
    size_t n = dynid_model_n_joints(model);
    size_t n_terms = dynid_model_n_terms(model);
    fprintf(stderr, "%s, torques in %s:", dynid_model_robot_name(model), dynid_model_torque_unit(model));
    for (size_t j = 0; j < n; j++) {
        fprintf(stderr, " %s [%s]", dynid_model_joint_name(model, j), dynid_model_joint_unit(model, j));
    }
    fputs("\nterms:", stderr);
    for (size_t k = 0; k < n_terms; k++) {
        fprintf(stderr, " %s", dynid_model_term_name(model, k));
    }
    fputc('\n', stderr);

    DynidEstimator *estimator = NULL;
    check(dynid_estimator_new(model, 0.0, &estimator));
    dynid_model_free(model); /* the estimator has its own share */

    double *line = zeros((size_t)n_signals * n);
    double *tau = zeros(n);
    double *terms = zeros(n_terms * n);
    double *std_dev = zeros(n);
    DynidState state = {line, line + n, line + 2 * n, NULL, NULL, NULL, NULL};
    if (n_signals >= 6) {
        state.q_motor = line + 3 * n;
        state.dq_motor = line + 4 * n;
        state.ddq_motor = line + 5 * n;
    }
    if (n_signals == 7) {
        state.temperature = line + 6 * n;
    }

    size_t read = 0;
    while (scanf("%lf", &line[read]) == 1) {
        if (++read < (size_t)n_signals * n) {
            continue;
        }
        read = 0;
        uint32_t status = 0;
        check(dynid_estimator_estimate(estimator, &state, tau, n, &status));
        check(dynid_estimator_terms(estimator, terms, n_terms * n));
        check(dynid_estimator_predicted_std(estimator, std_dev, n));
        print(tau, n);
        print(terms, n_terms * n);
        print(std_dev, n);
        printf("%u\n", (unsigned)status);
    }

    free(line);
    free(tau);
    free(terms);
    free(std_dev);
    dynid_estimator_free(estimator);
    if (read != 0 || !feof(stdin)) {
        fputs("error: the input ends in the middle of a state, or holds something that is no number\n", stderr);
        return 2;
    }
    return 0;
}
