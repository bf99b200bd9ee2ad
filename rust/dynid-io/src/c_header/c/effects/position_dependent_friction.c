/* Friction that changes around the turn: s(v) (a cos N q + b sin N q). shape: N, eps. */
static inline void dynid_position_dependent_friction(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double s = dynid_friction_sign(x->dq_motor[j], shape[1], shape[2]), angle = shape[0] * x->q[j];
    (void)memory;
    columns[0] = s * cos(angle);
    columns[1] = s * sin(angle);
}
