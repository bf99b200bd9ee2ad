/* A header called arm.h, run over samples for tests/online/test_c_header.py. */
#include "arm.h"
#ifdef __cplusplus
extern "C" {
#endif
void run(int n_samples, double step, const double *const *signals, double *tau, double *terms, double *std_dev,
         unsigned *status);
int sizes(int which);
const char *name(int term, int k);
void run(int n_samples, double step, const double *const *signals, double *tau, double *terms, double *std_dev,
         unsigned *status)
{
    arm_estimator estimator;
    int k, i, j;
    arm_init(&estimator);
    if (step > 0.0) { estimator.step = step; }
    for (k = 0; k < n_samples; k++) {
        const double *at[7];
        for (i = 0; i < 7; i++) { at[i] = signals[i] ? signals[i] + k * ARM_N_JOINTS : signals[i]; }
        {
            arm_state state = {at[0], at[1], at[2], at[3], at[4], at[5], at[6]};
            status[k] = arm_estimate(&estimator, &state, tau + k * ARM_N_JOINTS);
        }
        for (i = 0; i < ARM_N_TERMS; i++) {
            for (j = 0; j < ARM_N_JOINTS; j++) {
                terms[(k * ARM_N_TERMS + i) * ARM_N_JOINTS + j] = estimator.terms[i][j];
            }
        }
        arm_predicted_std(&estimator, std_dev + k * ARM_N_JOINTS);
    }
}
int sizes(int which) { return which == 0 ? ARM_N_JOINTS : ARM_N_TERMS; }
const char *name(int term, int k) { return term ? arm_term_name(k) : arm_joint_name(k); }
#ifdef __cplusplus
}
#endif
