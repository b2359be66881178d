/* W = L U in place, without exchange of rows: W is close to a positive multiple of the mass matrix. */
static void NAME_factor(double *W)
{
    enum { n = NAME_FREEDOMS };
    for (int k = 0; k < n; k++)
        for (int i = k + 1; i < n; i++) {
            W[i * n + k] /= W[k * n + k];
            for (int j = k + 1; j < n; j++) W[i * n + j] -= W[i * n + k] * W[k * n + j];
        }
}

static void NAME_solve(const double *W, double *b)
{
    enum { n = NAME_FREEDOMS };
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) b[i] -= W[i * n + j] * b[j];
    for (int i = n - 1; i >= 0; b[i] /= W[i * n + i], i--)
        for (int j = i + 1; j < n; j++) b[i] -= W[i * n + j] * b[j];
}

/* x after h seconds with constant u: RODAS (Hairer & Wanner 1996, section IV.10), of order 4 and L-stable. Its six
   stages solve (1/g - J) k = r with J = df/dx of the first one. With M J_v = N = (K D ...), the rates k_v of k are
   those of (M/g - D - g K) k_v = M r_v + g K r_q. The number of operations does not depend on x, u and h. */
void NAME_step(double *x, const double *u, double h)
{
    enum { n = NAME_FREEDOMS, columns = 2 * n + NAME_INPUTS };
    static const double a[6][5] = {
        {0.0}, {1.544}, {0.9466785280815826, 0.2557011698983284},
        {3.314825187068521, 2.896124015972201, 0.9986419139977817},
        {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895},
        {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0}};
    static const double c[6][5] = {
        {0.0}, {-5.6688}, {-2.430093356833875, -0.2063599157091915},
        {-0.1073529058151375, -9.594562251023355, -20.47028614809616},
        {7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616},
        {8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054}};
    const double g = 0.25 * h;
    double M[n * n], N[n * columns], W[n * n], k[6][2 * n], y[2 * n], r[2 * n];

    NAME_implicit(x, u, M, N);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) W[i * n + j] = M[i * n + j] / g - N[i * columns + n + j] - g * N[i * columns + j];
    NAME_factor(W);
    for (int s = 0; s < 6; s++) {
        double *q = k[s], *v = k[s] + n;
        for (int i = 0; i < 2 * n; i++) y[i] = x[i];
        for (int j = 0; j < s; j++)
            for (int i = 0; i < 2 * n; i++) y[i] += a[s][j] * k[j][i];
        NAME_rate(y, u, r);
        for (int j = 0; j < s; j++)
            for (int i = 0; i < 2 * n; i++) r[i] += c[s][j] / h * k[j][i];
        for (int i = 0; i < n; i++) {
            v[i] = 0.0;
            for (int j = 0; j < n; j++) v[i] += M[i * n + j] * r[n + j] + g * N[i * columns + j] * r[j];
        }
        NAME_solve(W, v);
        for (int i = 0; i < n; i++) q[i] = g * (r[i] + v[i]);
    }
    for (int i = 0; i < 2 * n; i++) x[i] = y[i] + k[5][i];
}
