/* Friction before sliding: k z along the motor's way. shape: distance d. */
static inline void dynid_friction_hysteresis(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    columns[0] = dynid_bristles(shape[0], x->q_motor[j], memory);
}
