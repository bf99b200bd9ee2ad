/* As if nothing had come yet. */
static inline void dynid_init(dynid_estimator *estimator)
{
    int j, k;
    estimator->step = DYNID_STEP;
    for (k = 0; k < DYNID_N_MEMORY; k++) {
        estimator->memory[k] = 0.0;
    }
    for (j = 0; j < DYNID_N_JOINTS; j++) {
        for (k = 0; k < DYNID_N_TERMS; k++) {
            estimator->terms[k][j] = 0.0;
        }
        estimator->tau[j] = 0.0;
        estimator->variance[j] = dynid_noise_std[j] * dynid_noise_std[j];
    }
#if DYNID_N_DELAY > 0
    estimator->passed = 0.0;
    estimator->newest = estimator->count = 0;
#endif
#if DYNID_N_LATE > 0
    estimator->passed_steps = 0.0;
    estimator->newest_step = estimator->n_steps = 0;
#endif
}

static inline int dynid_all_numbers(const double *values)
{
    int j, numbers = 1;
    for (j = 0; values && j < DYNID_N_JOINTS; j++) {
        numbers &= fabs(values[j]) < 1e100; /* no sensor shows more; false for NaN */
    }
    return numbers;
}

/* One step: the torque of every joint into tau (DYNID_N_JOINTS doubles), what was unusual as the result. Call it once per
 * cycle, in order of time: effects remember. tau is finite whatever comes in; a step that is none repeats the last good
 * torque (zeros before the first) and leaves what is remembered as it was. */
static inline unsigned dynid_estimate(dynid_estimator *estimator, const dynid_state *state, double *tau)
{
    double terms[DYNID_N_TERMS][DYNID_N_JOINTS], memory[DYNID_N_MEMORY], variance[DYNID_N_JOINTS];
    unsigned status = 0;
    int usable = dynid_all_numbers(state->q) && dynid_all_numbers(state->dq) && dynid_all_numbers(state->ddq)
              && dynid_all_numbers(state->q_motor) && dynid_all_numbers(state->dq_motor)
              && dynid_all_numbers(state->ddq_motor);
    const int is_state = usable;
    int j, k;
    dynid_motion motion;
    const double *q = motion.signals[0], *dq = motion.signals[1], *ddq = motion.signals[2];
    if (usable) {
        dynid_input x;
        dynid_take_motion(state, &motion);
#if DYNID_N_DELAY > 0
        if (!dynid_look_back(estimator, &motion)) {
            status |= DYNID_SETTLING;
        }
#endif
        if (dynid_hold(&motion)) {
            status |= DYNID_BEYOND_LIMITS | DYNID_OUTSIDE_DOMAIN;
        }
        dynid_take_true_state(&motion, &x);
        x.temperature = state->temperature;
        x.step = estimator->step;
        dynid_rigid_body(&x);
        for (k = 0; k < DYNID_N_MEMORY; k++) {
            memory[k] = estimator->memory[k];
        }
        for (j = 0; j < DYNID_N_JOINTS; j++) {
            terms[0][j] = x.tau_link[j] * dynid_torque_scale[j];
            variance[j] = dynid_noise_std[j] * dynid_noise_std[j];
        }
        if (dynid_other_terms(&x, memory, terms, variance)) {
            status |= DYNID_RESIDUAL_FADED;
        }
        for (k = 0; k < DYNID_N_TERMS; k++) {
            for (j = 0; j < DYNID_N_JOINTS; j++) {
                usable &= fabs(terms[k][j]) < 1e300; /* beyond it is an overflow, not a torque; false for NaN */
            }
        }
        for (k = 0; k < DYNID_N_MEMORY; k++) {
            usable &= isfinite(memory[k]) != 0;
        }
    }
    if (usable) {
        for (j = 0; j < DYNID_N_JOINTS; j++) {
            double sum = 0.0;
            int inside = dynid_domain_q[j][0] <= q[j] && q[j] <= dynid_domain_q[j][1] && fabs(dq[j]) <= dynid_domain_dq[j]
                      && fabs(ddq[j]) <= dynid_domain_ddq[j];
            if (!inside) {
                status |= DYNID_OUTSIDE_DOMAIN;
            }
            if (dynid_wants_temperature[j] && !(state->temperature && isfinite(state->temperature[j]))) {
                status |= DYNID_SIGNAL_MISSING;
            }
            for (k = 0; k < DYNID_N_TERMS; k++) {
                estimator->terms[k][j] = terms[k][j];
                sum += terms[k][j];
            }
            estimator->tau[j] = sum;
            estimator->variance[j] = variance[j];
        }
        for (k = 0; k < DYNID_N_MEMORY; k++) {
            estimator->memory[k] = memory[k];
        }
#if DYNID_N_LATE > 0
        const unsigned stands_for_another = status & DYNID_SETTLING;
        if (!dynid_show_late(estimator)) {
            status |= DYNID_SETTLING;
        }
        if (stands_for_another) {
            estimator->n_steps = 0;
        }
#endif
    } else {
        status = DYNID_NON_FINITE;
#if DYNID_N_LATE > 0
        estimator->passed_steps += estimator->step;
#endif
    }
#if DYNID_N_DELAY > 0
    estimator->passed += is_state ? 0.0 : estimator->step;
#else
    (void)is_state;
#endif
    for (j = 0; j < DYNID_N_JOINTS; j++) {
        tau[j] = estimator->tau[j];
    }
    return status;
}

/* Standard deviation that the model expects of measured minus predicted torque at the last step. */
static inline void dynid_predicted_std(const dynid_estimator *estimator, double *std_dev)
{
    int j;
    for (j = 0; j < DYNID_N_JOINTS; j++) {
        std_dev[j] = sqrt(estimator->variance[j]);
    }
}
