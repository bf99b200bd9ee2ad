/* The paper's friction (Eqs. 9-11): Coulomb, and viscous of three orders from lambda on, each direction its own; s: the sign of dq. */
static inline void dynid_friction_columns(double s, double dq, double lambda, double *columns)
{
    double gate = (1.0 + fabs(s)) / 2.0;
    int side = dq < 0.0, k;
    for (k = 0; k < 8; k++) {
        columns[k] = 0.0;
    }
    columns[side] = s * gate;
    if (fabs(dq) >= lambda) {
        columns[2 + side] = gate * dq;
        columns[4 + side] = dq * dq;
        columns[6 + side] = dq * dq * dq;
    }
}
