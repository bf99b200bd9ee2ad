/* Every function of dynid.h with good and with bad arguments; what it says is checked. Ends with "all N checks". */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dynid.h"

static int checks = 0;

static void check(int good, const char *what, int line)
{
    checks++;
    if (!good) {
        printf("line %d: %s; last error: %s\n", line, what, dynid_last_error());
        exit(1);
    }
}

#define CHECK(condition) check((condition), #condition, __LINE__)
#define REFUSED(call, code, words) \
    check((call) == (code) && strstr(dynid_last_error(), (words)) != NULL, #call " -> " words, __LINE__)

static char *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    CHECK(file != NULL);
    fseek(file, 0, SEEK_END);
    *size = (size_t)ftell(file);
    rewind(file);
    char *bytes = malloc(*size);
    CHECK(bytes != NULL && fread(bytes, 1, *size, file) == *size);
    fclose(file);
    return bytes;
}

static void facts(const DynidModel *model, size_t n)
{
    CHECK(n == 6 && dynid_model_n_terms(model) >= 2);
    CHECK(strlen(dynid_model_robot_name(model)) > 0);
    CHECK(strcmp(dynid_model_joint_unit(model, 5), "rad") == 0);
    CHECK(strcmp(dynid_model_term_name(model, 0), "rigid_body") == 0);
    CHECK(strcmp(dynid_model_torque_unit(model), "N*m") == 0);
    CHECK(strlen(dynid_model_joint_name(model, 0)) > 0);
    CHECK(dynid_model_step(model) == 0.004);
    CHECK(dynid_model_wants_temperature(model, 0));
    CHECK(dynid_model_wants_motor_side(model));
    CHECK(dynid_model_joint_name(model, 6) == NULL);
    CHECK(strstr(dynid_last_error(), "there is no joint 6") != NULL);
    CHECK(dynid_model_joint_unit(model, SIZE_MAX) == NULL);
    CHECK(dynid_model_term_name(model, 1000) == NULL);
    CHECK(!dynid_model_wants_temperature(model, 6));
    CHECK(dynid_model_n_joints(NULL) == 0 && dynid_model_n_terms(NULL) == 0 && dynid_model_step(NULL) == 0.0);
    CHECK(dynid_model_robot_name(NULL) == NULL && dynid_model_torque_unit(NULL) == NULL);
    CHECK(!dynid_model_wants_temperature(NULL, 0) && !dynid_model_wants_motor_side(NULL));
    CHECK(strcmp(dynid_last_error(), "model is NULL") == 0);
}

static void refused(DynidEstimator *estimator, size_t n)
{
    double x[8] = {0.1, 0.2, 0.3, 0.4, 0.5, 0.6}, tau[8] = {0}, terms[6 * 64];
    uint32_t status = 77;
    DynidState good = {x, x, x, x, x, x, x}, state = good;
    REFUSED(dynid_estimator_estimate(NULL, &good, tau, n, &status), DYNID_CODE_POINTER, "estimator is NULL");
    REFUSED(dynid_estimator_estimate(estimator, NULL, tau, n, &status), DYNID_CODE_POINTER, "state is NULL");
    REFUSED(dynid_estimator_estimate(estimator, &good, NULL, n, &status), DYNID_CODE_POINTER, "tau is NULL");
    REFUSED(dynid_estimator_estimate(estimator, &good, tau, n, NULL), DYNID_CODE_POINTER, "status is NULL");
    REFUSED(dynid_estimator_estimate(estimator, &good, tau, 5, &status), DYNID_CODE_LENGTH,
            "n_joints is 5, the model needs 6");
    REFUSED(dynid_estimator_estimate(estimator, &good, tau, SIZE_MAX, &status), DYNID_CODE_LENGTH, "n_joints");
    state.dq = NULL;
    REFUSED(dynid_estimator_estimate(estimator, &state, tau, n, &status), DYNID_CODE_POINTER, "dq is NULL");
    state = good;
    state.dq_motor = NULL;
    REFUSED(dynid_estimator_estimate(estimator, &state, tau, n, &status), DYNID_CODE_POINTER, "come together");
    state = good;
    state.q = (const double *)(uintptr_t)((uintptr_t)x + 1);
    REFUSED(dynid_estimator_estimate(estimator, &state, tau, n, &status), DYNID_CODE_POINTER, "q is not aligned");
    CHECK(status == 77 && tau[0] == 0.0);
    REFUSED(dynid_estimator_terms(estimator, terms, 6), DYNID_CODE_LENGTH, "n_values");
    REFUSED(dynid_estimator_terms(NULL, terms, 6), DYNID_CODE_POINTER, "estimator is NULL");
    REFUSED(dynid_estimator_predicted_std(estimator, tau, 7), DYNID_CODE_LENGTH, "n_joints");
    REFUSED(dynid_estimator_predicted_std(estimator, NULL, 6), DYNID_CODE_POINTER, "std_dev is NULL");
    REFUSED(dynid_estimator_predicted_std(NULL, tau, 6), DYNID_CODE_POINTER, "estimator is NULL");
    REFUSED(dynid_estimator_reset(NULL), DYNID_CODE_POINTER, "estimator is NULL");
}

int main(int argc, char **argv)
{
    DynidModel *model = NULL, *parsed = NULL;
    DynidEstimator *estimator = NULL, *copy = NULL, *none = NULL;
    size_t size = 0;
    CHECK(argc >= 2 && strlen(dynid_version()) >= 5 && strlen(dynid_last_error()) == 0);

    REFUSED(dynid_model_load(NULL, &model), DYNID_CODE_POINTER, "path is NULL");
    REFUSED(dynid_model_load("/missing/\xff.json", &model), DYNID_CODE_FILE, "No such file");
    REFUSED(dynid_model_load(argv[0], &model), DYNID_CODE_MODEL, "not a text file");
    REFUSED(dynid_model_load(argv[1], NULL), DYNID_CODE_POINTER, "model is NULL");
    CHECK(model == NULL);
    CHECK(dynid_model_load(argv[1], &model) == DYNID_CODE_OK && model != NULL);

    char *bytes = read_file(argv[1], &size);
    REFUSED(dynid_model_parse(NULL, size, &parsed), DYNID_CODE_POINTER, "bytes is NULL");
    REFUSED(dynid_model_parse((uint8_t *)bytes, size / 2, &parsed), DYNID_CODE_MODEL, "model:");
    REFUSED(dynid_model_parse((uint8_t *)bytes, SIZE_MAX, &parsed), DYNID_CODE_LENGTH, "bytes");
    bytes[size / 2] ^= 1;
    REFUSED(dynid_model_parse((uint8_t *)bytes, size, &parsed), DYNID_CODE_MODEL, "model:");
    bytes[size / 2] ^= 1;
    CHECK(parsed == NULL);
    CHECK(dynid_model_parse((uint8_t *)bytes, size, &parsed) == DYNID_CODE_OK);
    free(bytes);

    size_t n = dynid_model_n_joints(model);
    facts(model, n);

    REFUSED(dynid_estimator_new(NULL, 0.0, &none), DYNID_CODE_POINTER, "model is NULL");
    REFUSED(dynid_estimator_new(model, 0.0, NULL), DYNID_CODE_POINTER, "estimator is NULL");
    REFUSED(dynid_estimator_new(model, -1.0, &none), DYNID_CODE_RANGE, "step");
    REFUSED(dynid_estimator_new(model, NAN, &none), DYNID_CODE_RANGE, "step");
    REFUSED(dynid_estimator_clone(NULL, &none), DYNID_CODE_POINTER, "estimator is NULL");
    CHECK(none == NULL);
    CHECK(dynid_estimator_new(model, 0.0, &estimator) == DYNID_CODE_OK);
    REFUSED(dynid_estimator_clone(estimator, NULL), DYNID_CODE_POINTER, "copy is NULL");
    dynid_model_free(model); /* estimators outlive it */
    refused(estimator, n);

    /* A copy goes on with what the original remembers; a reset one starts again. */
    double q[6], dq[6], ddq[6] = {0}, first[6] = {0}, tau[6], other[6], std_dev[6];
    uint32_t status = 0;
    for (int k = 0; k < 200; k++) {
        for (size_t j = 0; j < n; j++) {
            q[j] = sin(0.01 * k + (double)j);
            dq[j] = 2.5 * cos(0.01 * k + (double)j);
        }
        DynidState state = {q, dq, ddq, NULL, NULL, NULL, NULL};
        CHECK(dynid_estimator_estimate(estimator, &state, tau, n, &status) == DYNID_CODE_OK);
        if (k == 0) {
            memcpy(first, tau, sizeof first);
        }
        if (k == 100) {
            CHECK(dynid_estimator_clone(estimator, &copy) == DYNID_CODE_OK);
        } else if (k > 100) {
            CHECK(dynid_estimator_estimate(copy, &state, other, n, &status) == DYNID_CODE_OK);
            CHECK(memcmp(tau, other, sizeof tau) == 0);
        }
    }
    CHECK(status & DYNID_STATUS_SIGNAL_MISSING && status & DYNID_STATUS_OUTSIDE_DOMAIN);
    CHECK(dynid_estimator_predicted_std(estimator, std_dev, n) == DYNID_CODE_OK && std_dev[0] > 0.0);
    CHECK(dynid_estimator_reset(estimator) == DYNID_CODE_OK);
    for (size_t j = 0; j < n; j++) {
        q[j] = sin((double)j);
        dq[j] = 2.5 * cos((double)j);
    }
    /* The answer may overwrite what came in, and a step that is none repeats the last answer. */
    DynidState state = {q, dq, ddq, NULL, NULL, NULL, NULL};
    CHECK(dynid_estimator_estimate(estimator, &state, dq, n, &status) == DYNID_CODE_OK);
    CHECK(memcmp(dq, first, sizeof first) == 0);
    dq[0] = NAN;
    CHECK(dynid_estimator_estimate(estimator, &state, tau, n, &status) == DYNID_CODE_OK);
    CHECK(status == DYNID_STATUS_NON_FINITE && memcmp(tau, first, sizeof first) == 0);

    if (argc == 2) { /* with a second word this one is leaked on purpose */
        dynid_estimator_free(estimator);
    }
    estimator = NULL;
    dynid_estimator_free(copy);
    dynid_model_free(parsed);
    dynid_model_free(NULL);
    dynid_estimator_free(NULL);
    printf("all %d checks\n", checks);
    return 0;
}
