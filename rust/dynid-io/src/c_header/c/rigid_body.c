static inline void dynid_cross(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void dynid_turn(const double *r, const double *x, double *y) /* y = R x */
{
    int i;
    for (i = 0; i < 3; i++) {
        y[i] = r[3 * i] * x[0] + r[3 * i + 1] * x[1] + r[3 * i + 2] * x[2];
    }
}

static inline void dynid_turn_back(const double *r, const double *x, double *y) /* y = R^T x */
{
    int i;
    for (i = 0; i < 3; i++) {
        y[i] = r[i] * x[0] + r[3 + i] * x[1] + r[6 + i] * x[2];
    }
}

/* Link to parent at q: rotation (row by row) and origin. */
static inline void dynid_placement(const dynid_joint *joint, double q, double *rotation, double *origin)
{
    const double *u = joint->axis, *r = joint->rotation;
    double slide[3], turn[9];
    int i, j;
    if (joint->slides) {
        for (i = 0; i < 3; i++) {
            slide[i] = u[i] * q;
        }
        dynid_turn(r, slide, origin);
        for (i = 0; i < 3; i++) {
            origin[i] = joint->translation[i] + origin[i];
        }
        for (i = 0; i < 9; i++) {
            rotation[i] = r[i];
        }
        return;
    }
    {
        double s = sin(q), c = cos(q), v = 1.0 - c;
        turn[0] = u[0] * u[0] + (1.0 - u[0] * u[0]) * c;
        turn[1] = u[0] * u[1] * v - u[2] * s;
        turn[2] = u[0] * u[2] * v + u[1] * s;
        turn[3] = u[0] * u[1] * v + u[2] * s;
        turn[4] = u[1] * u[1] + (1.0 - u[1] * u[1]) * c;
        turn[5] = u[1] * u[2] * v - u[0] * s;
        turn[6] = u[0] * u[2] * v - u[1] * s;
        turn[7] = u[1] * u[2] * v + u[0] * s;
        turn[8] = u[2] * u[2] + (1.0 - u[2] * u[2]) * c;
    }
    for (i = 0; i < 3; i++) {
        for (j = 0; j < 3; j++) {
            rotation[3 * i + j] = r[3 * i] * turn[j] + r[3 * i + 1] * turn[3 + j] + r[3 * i + 2] * turn[6 + j];
        }
        origin[i] = joint->translation[i];
    }
}

/* Wrench of a body about its frame's origin, by Newton and Euler:
 *   f = m a + S h,  n = h x a + I alpha + omega x (I omega),  S = [alpha]x + [omega]x [omega]x,
 * w = omega, al = alpha, a = acceleration of the origin minus gravity, all in the body's frame. */
static inline void dynid_wrench(const double *w, const double *al, const double *a, const double *phi, double *f, double *n)
{
    double xx = w[0] * w[0], yy = w[1] * w[1], zz = w[2] * w[2];
    double xy = w[0] * w[1], xz = w[0] * w[2], yz = w[1] * w[2];
    double m = phi[0], hx = phi[1], hy = phi[2], hz = phi[3];
    double i_xx = phi[4], i_xy = phi[5], i_yy = phi[6], i_xz = phi[7], i_yz = phi[8], i_zz = phi[9];
    f[0] = a[0] * m - (yy + zz) * hx + (xy - al[2]) * hy + (xz + al[1]) * hz;
    f[1] = a[1] * m + (xy + al[2]) * hx - (xx + zz) * hy + (yz - al[0]) * hz;
    f[2] = a[2] * m + (xz - al[1]) * hx + (yz + al[0]) * hy - (xx + yy) * hz;
    n[0] = a[2] * hy - a[1] * hz + al[0] * i_xx + (al[1] - xz) * i_xy - yz * i_yy + (al[2] + xy) * i_xz
         + (yy - zz) * i_yz + yz * i_zz;
    n[1] = -a[2] * hx + a[0] * hz + xz * i_xx + (al[0] + yz) * i_xy + al[1] * i_yy + (zz - xx) * i_xz
         + (al[2] - xy) * i_yz - xz * i_zz;
    n[2] = a[1] * hx - a[0] * hy - xy * i_xx + (xx - yy) * i_xy + xy * i_yy + (al[0] - yz) * i_xz
         + (al[1] + xz) * i_yz + al[2] * i_zz;
}

/* Torque of the links alone, x->tau_link = M(q) ddq + C(q, dq) + G(q), by the recursive Newton-Euler algorithm. */
static inline void dynid_rigid_body(dynid_input *x)
{
    double rotation[DYNID_N_JOINTS][9], origin[DYNID_N_JOINTS][3];
    double force[DYNID_N_JOINTS][3], moment[DYNID_N_JOINTS][3];
    double omega[3] = {0.0, 0.0, 0.0}, alpha[3] = {0.0, 0.0, 0.0}, acc[3];
    int i, k;
    for (k = 0; k < 3; k++) {
        acc[k] = -dynid_gravity[k]; /* gravity as an upward acceleration of the base */
    }
    for (i = 0; i < DYNID_N_JOINTS; i++) {
        const dynid_joint *joint = &dynid_joints[i];
        double carried[3], w[3], al[3], swept[3], inner[3], outer[3], sweep[3];
        dynid_placement(joint, x->q[i], rotation[i], origin[i]);
        dynid_cross(alpha, origin[i], swept);
        dynid_cross(omega, origin[i], inner);
        dynid_cross(omega, inner, outer);
        for (k = 0; k < 3; k++) {
            carried[k] = acc[k] + swept[k] + outer[k];
        }
        dynid_turn_back(rotation[i], omega, w);
        dynid_turn_back(rotation[i], alpha, al);
        dynid_turn_back(rotation[i], carried, acc);
        dynid_cross(w, joint->axis, sweep);
        for (k = 0; k < 3; k++) {
            if (joint->slides) {
                acc[k] += sweep[k] * (2.0 * x->dq[i]) + joint->axis[k] * x->ddq[i];
            } else {
                al[k] += sweep[k] * x->dq[i] + joint->axis[k] * x->ddq[i];
                w[k] += joint->axis[k] * x->dq[i];
            }
            omega[k] = w[k];
            alpha[k] = al[k];
        }
        dynid_wrench(omega, alpha, acc, joint->phi, force[i], moment[i]);
    }
    for (i = DYNID_N_JOINTS - 1; i >= 0; i--) {
        const double *axis = dynid_joints[i].axis;
        const double *along = dynid_joints[i].slides ? force[i] : moment[i];
        x->tau_link[i] = axis[0] * along[0] + axis[1] * along[1] + axis[2] * along[2];
        if (i > 0) {
            double f[3], n[3], lever[3];
            dynid_turn(rotation[i], force[i], f);
            dynid_turn(rotation[i], moment[i], n);
            dynid_cross(origin[i], f, lever);
            for (k = 0; k < 3; k++) {
                force[i - 1][k] += f[k];
                moment[i - 1][k] += n[k] + lever[k];
            }
        }
    }
}
