/* Ripple of gear teeth or motor poles and its second harmonic. shape: N. */
static inline void dynid_torque_ripple(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double angle = shape[0] * x->q_motor[j];
    (void)memory;
    columns[0] = cos(angle);
    columns[1] = sin(angle);
    columns[2] = cos(2.0 * angle);
    columns[3] = sin(2.0 * angle);
}
