/* True motion of a joint from what an eccentric encoder shows: q + e(q) = shown, e(q) = c cos q + s sin q. */
static inline void dynid_true_motion(double *q, double *dq, double *ddq, const double *parts)
{
    double c = parts[0], s = parts[1], shown = *q, x = shown, e, rate;
    int k;
    for (k = 0; k < 4; k++) { /* Newton: each step squares the error */
        e = c * cos(x) + s * sin(x);
        rate = s * cos(x) - c * sin(x);
        x -= (x + e - shown) / (1.0 + rate);
    }
    e = c * cos(x) + s * sin(x);
    rate = s * cos(x) - c * sin(x);
    *q = x;
    *dq = *dq / (1.0 + rate);
    *ddq = (*ddq + e * *dq * *dq) / (1.0 + rate);
}

/* What the channels show, less the encoders' error, all on the motor channel's clock. */
static inline void dynid_take_true_state(const dynid_motion *shown, dynid_input *x)
{
    int j;
    for (j = 0; j < DYNID_N_JOINTS; j++) {
        double delay = dynid_encoder_delay[j];
        x->q[j] = shown->signals[0][j];
        x->dq[j] = shown->signals[1][j];
        x->ddq[j] = shown->signals[2][j];
        x->q_motor[j] = shown->signals[3][j];
        x->dq_motor[j] = shown->signals[4][j];
        x->ddq_motor[j] = shown->signals[5][j];
        /* An encoder's error is that of the angle at the time that it shows, so it goes before the delay does. */
        if (DYNID_ENCODER_ERROR >= 1) {
            dynid_true_motion(&x->q[j], &x->dq[j], &x->ddq[j], dynid_encoder_error[j]);
        }
        if (DYNID_ENCODER_ERROR >= 2) {
            dynid_true_motion(&x->q_motor[j], &x->dq_motor[j], &x->ddq_motor[j], dynid_encoder_error[j]);
        }
        x->q[j] = x->q[j] + delay * x->dq[j] + 0.5 * delay * delay * x->ddq[j];
        x->dq[j] = x->dq[j] + delay * x->ddq[j];
    }
}
