/* Friction of a joint's bearing under the torque of its neighbour n: m |tau_link_n| s(v). shape: side, eps, p. */
static inline void dynid_bearing_friction(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    int neighbour = shape[0] < 0.0 ? j - 1 : j + 1;
    double load = neighbour >= 0 && neighbour < DYNID_N_JOINTS ? fabs(x->tau_link[neighbour]) : 0.0;
    (void)memory;
    columns[0] = load * dynid_friction_sign(x->dq_motor[j], shape[1], shape[2]);
}
