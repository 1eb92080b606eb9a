#include "common/accuracy/target.h"

#include <math.h>

#include "common/math/elementary.h"

static double codes_of_psnr(double psnr_db) { return 255 * det_pow_d(10, -psnr_db / 20); }

struct accuracy_point target_point(const struct accuracy_figures *f, double cost, enum allocation_measure measure)
{
    if (!f->known)
        return (struct accuracy_point){.cost = cost};
    switch (measure) {
    case ALLOCATION_PSNR:
        return (struct accuracy_point){cost, codes_of_psnr(f->psnr_db), codes_of_psnr(f->psnr_hi),
                                       codes_of_psnr(f->psnr_lo)};
    case ALLOCATION_RMSE: return (struct accuracy_point){cost, f->rmse_percent, f->rmse_lo, f->rmse_hi};
    default: return (struct accuracy_point){cost, f->display_error, f->display_lo, f->display_hi};
    }
}

double target_value(const struct allocation_target *target, double error)
{
    return target->measure == ALLOCATION_PSNR ? 20 * det_log_d(255 / error) / det_log_d(10) : error;
}

double target_error(const struct allocation_target *target)
{
    return target->measure == ALLOCATION_PSNR ? codes_of_psnr(target->value) : target->value;
}
