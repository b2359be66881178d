#ifdef NAME_TEST
#include <stdio.h>
static const double NAME_case_x[@count][@n] = {
@x
};
static const double NAME_case_u[@count][@m] = {
@u
};
static const double NAME_case_dx[@count][@n] = {
@dx
};
static const double NAME_case_tip[@count][3] = {
@tip
};
int main(void)
{
    double worst = 0.0, dx[@n], tip[3];
    for (int i = 0; i < @count; i++) {
        double size = 1e-300, off = 0.0;
        NAME_rate(NAME_case_x[i], NAME_case_u[i], dx);
        NAME_tip(NAME_case_x[i], tip);
        for (int k = 0; k < @n; k++) {
            size = fmax(size, fabs(NAME_case_dx[i][k]));
            off = fmax(off, fabs(dx[k] - NAME_case_dx[i][k]));
        }
        worst = fmax(worst, off / size);
        for (int k = 0; k < 3; k++)
            worst = fmax(worst, fabs(tip[k] - NAME_case_tip[i][k]) / @size);
    }
    printf("largest relative difference from flexlink: %.2g\n", worst);
    return worst <= @allowed ? 0 : 1;
}
#endif
