/* Colour temperature to a matrix. */
#include "common/image/color.h"
#include "common/tonemap/operators.h"

/* The Planckian locus by the cubic splines of Kim et al. (US patent 7,024,034), 1667 to 4000 K. */
static void planckian(double kelvin, double xy[2])
{
    double t = 1000.0 / kelvin, x;

    x = ((-0.2661239 * t - 0.2343589) * t + 0.8776956) * t + 0.179910;
    xy[0] = x;
    if (kelvin < 2222.0)
        xy[1] = ((-1.1063814 * x - 1.34811020) * x + 2.18555832) * x - 0.20219683;
    else
        xy[1] = ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867;
}

/* The daylight locus (CIE 15:2004, section 3.1), 4000 to 25000 K. */
static void daylight(double kelvin, double xy[2])
{
    double t = 1000.0 / kelvin, x;

    if (kelvin <= 7000.0)
        x = ((-4.6070 * t + 2.9678) * t + 0.09911) * t + 0.244063;
    else
        x = ((-2.0064 * t + 1.9018) * t + 0.24748) * t + 0.237040;
    xy[0] = x;
    xy[1] = (-3.000 * x + 2.870) * x - 0.275;
}

void tonemap_white_balance(double kelvin, double out[3][3])
{
    double white[2];

    if (kelvin < 4000.0)
        planckian(kelvin, white);
    else
        daylight(kelvin, white);
    if (color_white_to_d65(white, out))
        return;
    for (int i = 0; i < 9; i++)
        out[i / 3][i % 3] = i % 4 == 0;
}
