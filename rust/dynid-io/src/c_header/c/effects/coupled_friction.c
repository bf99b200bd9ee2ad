/* Friction of a gear stage that two joints turn: k s(u) + d u, u = v_j + r v_p. shape: partner p, r, eps, sharpness. */
static inline void dynid_coupled_friction(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    (void)memory;
    columns[0] = columns[1] = 0.0;
    if (shape[0] >= 0.0) {
        double dq = x->dq_motor[j] + shape[1] * x->dq_motor[(int)shape[0]];
        columns[0] = dynid_friction_sign(dq, shape[2], shape[3]);
        columns[1] = dq;
    }
}
