/* Where a frame's camera stands, and how fast frames follow each other, as other programs read it of a header. */
#include <math.h>
#include <string.h>

#include "coordinator/pictures/view.h"
#include "coordinator/pictures/develop_parts.h"

/* OpenEXR's vectors are rows. */
static void store_transposed(const double from[4][4], float out[16])
{
    for (int r = 0; r < 4; r++)
        for (int c = 0; c < 4; c++)
            out[4 * c + r] = (float)from[r][c];
}

/* 24, 30000/1001, or thousandths. */
static void find_rate(struct development_view *view, double fps)
{
    double whole = round(fps), film = round(fps * 1.001);

    view->rate[0] = (int32_t)round(fps * 1000);
    view->rate[1] = 1000;
    if (fabs(fps - whole) < 1e-4) {
        view->rate[0] = (int32_t)whole;
        view->rate[1] = 1;
    } else if (fabs(fps - film / 1.001) < 1e-3) {
        view->rate[0] = (int32_t)film * 1000;
        view->rate[1] = 1001;
    }
}

status development_find_view(const struct development *d, struct development_view *view, struct error *err)
{
    struct scene_view found;

    memset(view, 0, sizeof *view);
    find_rate(view, (double)d->settings.fps);
    if (!d->described)
        return STATUS_OK;
    TRY(scene_view_find(&d->description, &d->settings, d->frame, SPACE_OF_FILE, &found, err));
    view->has_camera = found.has_camera;
    view->has_ndc = found.has_screen;
    store_transposed((const double(*)[4])found.to_camera, view->to_camera);
    store_transposed((const double(*)[4])found.to_screen, view->to_ndc);
    return STATUS_OK;
}
