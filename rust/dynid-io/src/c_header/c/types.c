/* One state: each pointer leads to DYNID_N_JOINTS doubles. With one encoder per joint the motor side is NULL, all three. */
typedef struct {
    const double *q;           /* link side [rad, m] */
    const double *dq;          /* [rad/s, m/s] */
    const double *ddq;         /* [rad/s^2, m/s^2] */
    const double *q_motor;     /* motor side, divided by the gear ratio; or NULL */
    const double *dq_motor;
    const double *ddq_motor;
    const double *temperature; /* [degC], NaN where one is not known; or NULL */
} dynid_state;

typedef struct {
    double signals[6][DYNID_N_JOINTS]; /* as they stand in a state */
} dynid_motion;

#if DYNID_N_LATE > 0
/* What a step found, and the time from the one before [s]. */
typedef struct {
    double terms[DYNID_N_TERMS][DYNID_N_JOINTS], variance[DYNID_N_JOINTS], apart;
} dynid_step;
#endif

/* What is remembered from step to step. Prepare it with dynid_init, one for each robot. */
typedef struct {
    double step;                                 /* time between states [s]; change it after dynid_init where it differs */
    double memory[DYNID_N_MEMORY];               /* of the effects */
    double terms[DYNID_N_TERMS][DYNID_N_JOINTS]; /* torque of every term at the last good step */
    double tau[DYNID_N_JOINTS];                  /* their sum */
    double variance[DYNID_N_JOINTS];             /* expected of measured minus predicted torque */
#if DYNID_N_DELAY > 0
    dynid_motion past[DYNID_N_DELAY]; /* a ring of the last states, for a torque channel that is late */
    double apart[DYNID_N_DELAY];      /* time from the state before [s], of each of them */
    double passed;                    /* since the newest of them, in steps that brought none */
    int newest, count;
#endif
#if DYNID_N_LATE > 0
    dynid_step steps[DYNID_N_LATE]; /* a ring of the last steps, for torque channels that are late by themselves */
    double passed_steps;            /* time since the newest of them, in steps that were none */
    int newest_step, n_steps;
#endif
} dynid_estimator;

/* What effects and residual see of a step: the true state, and the load of the gears. */
typedef struct {
    double q[DYNID_N_JOINTS], dq[DYNID_N_JOINTS], ddq[DYNID_N_JOINTS];
    double q_motor[DYNID_N_JOINTS], dq_motor[DYNID_N_JOINTS], ddq_motor[DYNID_N_JOINTS];
    const double *temperature;
    double tau_link[DYNID_N_JOINTS];  /* rigid-body torque before the channel's scale */
    double tau_motor[DYNID_N_JOINTS]; /* torque of the motors before undeclared effects, where an effect reads it */
    double step;
} dynid_input;

typedef struct {
    int slides;            /* 0: turns about its axis, 1: slides along it */
    double rotation[9];    /* link to parent at q = 0, row by row */
    double translation[3]; /* of the joint in the parent frame [m] */
    double axis[3];
    double phi[10];        /* m, m c, Ixx Ixy Iyy Ixz Iyz Izz about the link's origin */
} dynid_joint;
