/* The angles of a joint at which an effect has ends [from, to]: the nearest within them, for as long as it is evaluated. */
static inline double dynid_nearest(double angle, const double *ends)
{
    return angle < ends[0] ? ends[0] : angle > ends[1] ? ends[1] : angle;
}

static inline void dynid_hold_angle(dynid_input *x, int j, const double *ends, double *unheld)
{
    unheld[0] = x->q[j];
    unheld[1] = x->q_motor[j];
    x->q[j] = dynid_nearest(unheld[0], ends);
    x->q_motor[j] = dynid_nearest(unheld[1], ends);
}

static inline void dynid_release_angle(dynid_input *x, int j, const double *unheld)
{
    x->q[j] = unheld[0];
    x->q_motor[j] = unheld[1];
}
