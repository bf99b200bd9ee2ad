/* What was unusual about a step, as bits; 0 is a good step. */
enum {
    DYNID_NON_FINITE = 1,     /* the state held a NaN or an infinity, or the torque overflowed: the last good torque again */
    DYNID_OUTSIDE_DOMAIN = 2, /* the state is outside the box that the model was trained on */
    DYNID_RESIDUAL_FADED = 4, /* the residual was asked far from its data; its torque was faded out */
    DYNID_SIGNAL_MISSING = 8, /* a temperature that friction follows is not known; its torque is zero on that joint */
    DYNID_SETTLING = 512,     /* the torque channel is late, and states do not reach back far enough yet */
    DYNID_BEYOND_LIMITS = 4096 /* the state is beyond the model's limits, and was evaluated at them */
};
