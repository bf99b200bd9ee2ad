/* Torque that an elastic gear loses while it winds up: k z along its load. shape: change of load d. */
static inline void dynid_gear_hysteresis(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    columns[0] = dynid_bristles(shape[0], x->tau_link[j], memory);
}
