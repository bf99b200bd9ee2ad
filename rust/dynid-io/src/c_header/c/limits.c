/* The motion of a state; with one encoder per joint the motor side is the link side. */
static inline void dynid_take_motion(const dynid_state *shown, dynid_motion *x)
{
    const double *from[6];
    int j, k;
    from[0] = shown->q;
    from[1] = shown->dq;
    from[2] = shown->ddq;
    from[3] = shown->q_motor ? shown->q_motor : shown->q;
    from[4] = shown->dq_motor ? shown->dq_motor : shown->dq;
    from[5] = shown->ddq_motor ? shown->ddq_motor : shown->ddq;
    for (k = 0; k < 6; k++) {
        for (j = 0; j < DYNID_N_JOINTS; j++) {
            x->signals[k][j] = from[k][j];
        }
    }
}

/* Brings what lies beyond the model's limits to them, for formulas give any torque to a speed that no arm has. 1 if
 * anything did. */
static inline int dynid_hold(dynid_motion *x)
{
    int j, k, beyond = 0;
    for (k = 0; k < 6; k++) {
        const double(*limits)[2] = k % 3 == 0 ? dynid_limits_q : k % 3 == 1 ? dynid_limits_dq : dynid_limits_ddq;
        for (j = 0; j < DYNID_N_JOINTS; j++) {
            double value = x->signals[k][j], low = limits[j][0], high = limits[j][1];
            beyond |= value < low || value > high;
            x->signals[k][j] = value < low ? low : value > high ? high : value;
        }
    }
    return beyond;
}
