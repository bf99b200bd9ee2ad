/* The same, growing with the load of the gear: k |tau_link| z. shape: distance d. */
static inline void dynid_load_hysteresis(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double z = dynid_bristles(shape[0], x->q_motor[j], memory);
    columns[0] = fabs(x->tau_link[j]) * z;
}
