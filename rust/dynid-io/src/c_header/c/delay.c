/* The torque channel is DYNID_TORQUE_DELAY seconds late: what it shows now is the torque of the state of then, on the
 * straight line between its neighbours. 0 as long as states do not reach back that far; the oldest one stands for it then. */
static inline int dynid_look_back(dynid_estimator *estimator, dynid_motion *x)
{
    int at, row, j, k;
    double age = 0.0;
    estimator->newest = estimator->newest + 1 < DYNID_N_DELAY ? estimator->newest + 1 : 0;
    estimator->count = estimator->count < DYNID_N_DELAY ? estimator->count + 1 : DYNID_N_DELAY;
    at = estimator->newest;
    estimator->past[at] = *x;
    estimator->apart[at] = estimator->step + estimator->passed;
    estimator->passed = 0.0;
    for (row = 1; row < estimator->count; row++) {
        int before = at == 0 ? DYNID_N_DELAY - 1 : at - 1;
        double older = age + estimator->apart[at];
        if (older >= DYNID_TORQUE_DELAY) {
            double weight = (DYNID_TORQUE_DELAY - age) / (older - age);
            for (k = 0; k < 6; k++) {
                for (j = 0; j < DYNID_N_JOINTS; j++) {
                    x->signals[k][j] = (1.0 - weight) * estimator->past[at].signals[k][j]
                                     + weight * estimator->past[before].signals[k][j];
                }
            }
            return 1;
        }
        at = before;
        age = older;
    }
    *x = estimator->past[at];
    return 0;
}
