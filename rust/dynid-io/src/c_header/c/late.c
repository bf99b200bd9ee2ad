/* The channel of joint j is dynid_own_delay[j] seconds later than all: what it shows now are the terms of then, on the
 * straight line between their neighbours. 0 as long as steps do not reach back that far; the oldest stands for it then. */
static inline int dynid_show_late(dynid_estimator *estimator)
{
    int j, k, row, reached = 1;
    dynid_step *now;
    estimator->newest_step = estimator->newest_step + 1 < DYNID_N_LATE ? estimator->newest_step + 1 : 0;
    estimator->n_steps = estimator->n_steps < DYNID_N_LATE ? estimator->n_steps + 1 : DYNID_N_LATE;
    now = &estimator->steps[estimator->newest_step];
    now->apart = estimator->step + estimator->passed_steps;
    estimator->passed_steps = 0.0;
    for (j = 0; j < DYNID_N_JOINTS; j++) {
        for (k = 0; k < DYNID_N_TERMS; k++) {
            now->terms[k][j] = estimator->terms[k][j];
        }
        now->variance[j] = estimator->variance[j];
    }
    for (j = 0; j < DYNID_N_JOINTS; j++) {
        int late = estimator->newest_step, early = late, found = 0;
        double age = 0.0, weight = 0.0, sum = 0.0;
        for (row = 1; row < estimator->n_steps && !found; row++) {
            double older = age + estimator->steps[late].apart;
            early = late == 0 ? DYNID_N_LATE - 1 : late - 1;
            found = older >= dynid_own_delay[j];
            if (found) {
                weight = (dynid_own_delay[j] - age) / (older - age);
            } else {
                late = early;
                age = older;
            }
        }
        reached &= found;
        for (k = 0; k < DYNID_N_TERMS; k++) {
            estimator->terms[k][j] = (1.0 - weight) * estimator->steps[late].terms[k][j]
                                   + weight * estimator->steps[early].terms[k][j];
            sum += estimator->terms[k][j];
        }
        estimator->tau[j] = sum;
        estimator->variance[j] = (1.0 - weight) * estimator->steps[late].variance[j]
                               + weight * estimator->steps[early].variance[j];
    }
    return reached;
}
