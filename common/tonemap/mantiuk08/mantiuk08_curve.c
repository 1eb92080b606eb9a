/* The tone curve of mantiuk08: the one whose perceived contrasts on the display are closest to the perceived contrasts
 * of the picture (section 4 of the paper).
 *
 * The unknowns are the curve's rises d over its segments. A contrast of g bins on the background node i spans the
 * segments from i to i + g, and gives one equation: the response to the sum of their rises should equal that to the
 * contrast in the picture, weighted by how often it occurs. The response is not linear, and depends on the display's
 * luminance through the eye's sensitivity. So it is linearised at the latest curve, and a quadratic programme is solved
 * until nothing changes any more. */
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/tonemap/mantiuk08/mantiuk08.h"

enum { ITERATIONS_MAX = 200 };

static const double SETTLED = 0.01;            /* change of a rise in log10 at which the iteration ends */
static const double FLAT = 1e-4;               /* below, a rise does not divide */
static const double SOFT_SHARE = 0.1;          /* weight of an equation that no pixel needs */
static const double SCENE_ADAPTATION = 1000.0; /* cd/m^2 */
static const double VIEWING_DISTANCE = 0.5;    /* metres */

/* ---- the visual model ----------------------------------------------------------------------- */

/* S. Daly, "The Visible Differences Predictor", in Digital Images and Human Vision, 1993: for one square degree. */
static double daly_s1(double rho, double luminance)
{
    double a = 0.801 * det_pow_d(1.0 + 0.7 / luminance, -0.2);
    double b = 0.3 * det_pow_d(1.0 + 100.0 / luminance, 0.15);
    double e = 0.9 * rho, size = 3.23 * det_pow_d(rho * rho, -0.3);

    return det_pow_d(size * size * size * size * size + 1.0, -0.2) * a * e * det_exp_d(-b * e) *
           sqrt(1.0 + 0.06 * det_exp_d(b * e));
}

double m08_sensitivity(double frequency, double luminance)
{
    double distance = 0.856 * det_pow_d(VIEWING_DISTANCE, 0.14);

    if (!(frequency > 0.0))
        return 0.0;
    return 250.0 * fmin(daly_s1(frequency, luminance), daly_s1(frequency / distance, luminance));
}

double m08_response(double contrast, double sensitivity)
{
    double weber = det_exp_d(fabs(contrast) * M08_LN10) - 1.0, seen = sensitivity * weber;
    double response =
        3.291 * (det_pow_d(1.0 + seen * seen * seen, 1.0 / 3.0) - 1.0) / (0.2599 * det_pow_d(3.433 + seen, 0.8));

    return contrast < 0.0 ? -response : response;
}

/* ---- the equations -------------------------------------------------------------------------- */

struct equation {
    int first, last; /* variables summed: first <= v < last */
    int band, node;  /* where the eye's sensitivity is taken */
    double target, weight;
};

struct fit {
    const struct m08_contrasts *contrasts;
    const struct m08_model *model;
    double y_min, y_max;        /* of the display */
    int low, high;              /* segments in use: low <= s < high */
    int variable[M08_SEGMENTS]; /* that a segment belongs to */
    int length[M08_SEGMENTS];   /* segments of a variable */
    int variables;
    struct equation *equations;
    size_t count;
    double d[M08_SEGMENTS];                       /* rises of the variables */
    double y[M08_NODES];                          /* from low to high */
    double seen[M08_BANDS_MAX][M08_NODES];        /* sensitivity at the nodes' luminances */
    double sensitivity[M08_BANDS_MAX][M08_NODES]; /* at the display's luminance of the nodes */
    struct m08_programme programme;
};

static void tabulate_sensitivity(struct fit *fit)
{
    for (uint32_t band = 0; band < fit->contrasts->bands; band++)
        for (int node = 0; node < M08_NODES; node++)
            fit->seen[band][node] =
                m08_sensitivity(fit->contrasts->frequency[band], det_exp_d((M08_X_MIN + node * M08_STEP) * M08_LN10));
}

/* At the scene, where the eye is adapted to that node, or to one luminance. */
static double scene_sensitivity(const struct fit *fit, int band, int node)
{
    if (fit->model->no_vision)
        return 1.0;
    return fit->model->adapts ? fit->seen[band][node]
                              : m08_sensitivity(fit->contrasts->frequency[band], SCENE_ADAPTATION);
}

static double response_of(const struct fit *fit, double contrast, double sensitivity)
{
    return fit->model->no_vision ? contrast * sensitivity : m08_response(contrast, sensitivity);
}

static int clamp_node(int node) { return node < 0 ? 0 : node < M08_NODES ? node : M08_NODES - 1; }

/* Call visit for every contrast that occurs, with the nodes that it spans. The authors' program leaves the brightest
 * bin out, which shows where a picture steps by more than two decades. To reproduce its curves, so does this. */
static void each_contrast(struct fit *fit,
                          void (*visit)(struct fit *fit, int band, int node, int from, int to, uint64_t count))
{
    for (int band = 0; band < (int)fit->contrasts->bands; band++)
        for (int node = 0; node < M08_NODES; node++)
            for (int g = 0; g < M08_BINS - 1; g++) {
                int from = clamp_node(node + (g < M08_CENTRE ? g - M08_CENTRE : 0));
                int to = clamp_node(node + (g > M08_CENTRE ? g - M08_CENTRE : 0));
                uint64_t count = fit->contrasts->counts[band][node][g];

                if (count > 0 && from < to)
                    visit(fit, band, node, from, to, count);
            }
}

static void mark_used(struct fit *fit, int band UNUSED, int node UNUSED, int from, int to, uint64_t count UNUSED)
{
    for (int s = from; s < to; s++)
        fit->variable[s] = 0;
    fit->low = from < fit->low ? from : fit->low;
    fit->high = to > fit->high ? to : fit->high;
    fit->count++;
}

/* Number the segments in use; a run of unused segments between them is one variable. */
static void number_variables(struct fit *fit)
{
    fit->variables = 0;
    for (int s = fit->low; s < fit->high; s++) {
        int gap = fit->variable[s] < 0;

        if (gap && s > fit->low && fit->length[fit->variables - 1] < 0) {
            fit->length[fit->variables - 1]--;
        } else {
            fit->length[fit->variables] = gap ? -1 : 1;
            fit->variables++;
        }
        fit->variable[s] = fit->variables - 1;
    }
}

static void add_equation(struct fit *fit, const struct equation *equation) { fit->equations[fit->count++] = *equation; }

static void add_contrast(struct fit *fit, int band, int node, int from, int to, uint64_t count)
{
    struct equation equation = {
        .first = fit->variable[from], .last = fit->variable[to - 1] + 1,
        .band = band, .node = node, .weight = (double)count,
    };

    /* The eye is adapted to the darker end, as in the authors' program. */
    equation.target =
        response_of(fit, fit->model->contrast * (to - from) * M08_STEP, scene_sensitivity(fit, band, from));
    add_equation(fit, &equation);
}

/* Also of the backgrounds that are seen without a contrast. */
static double visible_contrasts(const struct fit *fit)
{
    uint64_t sum = 0;

    for (uint32_t band = 0; band < fit->contrasts->bands; band++)
        for (int node = 0; node < M08_NODES; node++) {
            const uint64_t *counts = fit->contrasts->counts[band][node];

            for (int g = 0; g < M08_BINS && counts[M08_CENTRE] > 0; g++)
                sum += g == M08_CENTRE ? 0 : counts[g];
        }
    return (double)sum;
}

/* Gaps keep their contrast if there is room, as perceived at the lowest frequency; what should be
 * white must not rise any more. */
static void add_soft_equations(struct fit *fit, int white_node)
{
    double weight = SOFT_SHARE * visible_contrasts(fit), e = fit->model->contrast * M08_STEP;
    int node = fit->low, first = white_node < fit->low ? fit->low : white_node;

    for (int v = 0; v < fit->variables; v++) {
        if (fit->length[v] < 0) {
            int band = (int)fit->contrasts->bands - 1, length = -fit->length[v];
            struct equation gap = {.first = v, .last = v + 1, .band = band,
                                   .node = node + length, .weight = weight};

            fit->length[v] = length;
            gap.target = response_of(fit, e * length, scene_sensitivity(fit, band, node));
            add_equation(fit, &gap);
        }
        node += fit->length[v];
    }
    if (first < fit->high) {
        struct equation white = {.first = fit->variable[first], .last = fit->variables,
                                 .node = first, .weight = weight};

        add_equation(fit, &white);
    }
}

/* Count the equations, then number them, then write them. */
static status set_up(struct fit *fit, struct error *err)
{
    int white_node = M08_NODES;

    fit->low = M08_NODES - 1;
    for (int s = 0; s < M08_SEGMENTS; s++)
        fit->variable[s] = -1;
    each_contrast(fit, mark_used);
    if (fit->model->white > 0.0) {
        /* The lower end of the segment that contains it, or that it ends. */
        white_node = (int)ceil((m08_log(fit->model->white) - M08_X_MIN) / M08_STEP - 1e-9) - 1;
        if (fit->count > 0 && white_node > fit->high)
            fit->high = white_node; /* brighter than the picture: room above it */
    }
    if (fit->count == 0)
        return STATUS_OK;
    number_variables(fit);
    fit->equations = mem_alloc_array(fit->count + (size_t)fit->variables + 1, sizeof *fit->equations);
    NEED(fit->equations, err, "the equations of a tone curve");
    fit->count = 0;
    each_contrast(fit, add_contrast);
    add_soft_equations(fit, white_node);
    return STATUS_OK;
}

/* ---- the iteration -------------------------------------------------------------------------- */

/* y at the nodes in use: the rest of the display's range stays at its dark end. */
static void integrate(struct fit *fit)
{
    double sum = 0.0, y;

    for (int v = 0; v < fit->variables; v++)
        sum += fit->d[v];
    y = fmax(fit->y_max - sum, fit->y_min);
    fit->y[fit->low] = y;
    for (int s = fit->low; s < fit->high; s++) {
        int v = fit->variable[s];

        y += fit->d[v] / fit->length[v];
        fit->y[s + 1] = fmin(y, fit->y_max);
    }
}

/* Straight lines between nodes, as in the authors' program: the number of iterations depends on it. */
static void adapt_to_display(struct fit *fit)
{
    for (int node = fit->low; node <= fit->high; node++) {
        double place = (fit->y[node] - M08_X_MIN) * (1.0 / M08_STEP);
        int at = place < M08_NODES - 2 ? (int)place : M08_NODES - 2;

        for (uint32_t band = 0; band < fit->contrasts->bands; band++) {
            const double *seen = fit->seen[band] + at;

            fit->sensitivity[band][node] = fit->model->no_vision ? 1.0 : seen[0] + (place - at) * (seen[1] - seen[0]);
        }
    }
}

/* Linearise the equations at the present curve: H and f. */
static void fill_programme(struct fit *fit)
{
    struct m08_programme *p = &fit->programme;

    p->count = (size_t)fit->variables;
    p->limit = fit->y_max - fit->y_min;
    memset(p->h, 0, sizeof p->h);
    memset(p->f, 0, sizeof p->f);
    for (size_t i = 0; i < fit->count; i++) {
        const struct equation *e = &fit->equations[i];
        double rise = 0.0, k;

        for (int v = e->first; v < e->last; v++)
            rise += fit->d[v];
        k = response_of(fit, rise, fit->sensitivity[e->band][e->node]) / (fabs(rise) < FLAT ? 1.0 : rise);
        if (fit->model->no_vision)
            k = 1.0;
        for (int v = e->first; v < e->last; v++) {
            p->f[v] -= k * e->weight * e->target;
            for (int u = e->first; u <= v; u++)
                p->h[v][u] += k * k * e->weight;
        }
    }
}

static void iterate(struct fit *fit)
{
    for (int v = 0; v < fit->variables; v++)
        fit->d[v] = (fit->y_max - fit->y_min) / fit->variables;
    for (int i = 0; i < ITERATIONS_MAX; i++) {
        double change = 0.0;

        integrate(fit);
        adapt_to_display(fit);
        fill_programme(fit);
        m08_programme_solve(&fit->programme);
        for (int v = 0; v < fit->variables; v++) {
            change = fmax(change, fabs(fit->programme.d[v] - fit->d[v]));
            fit->d[v] = fit->programme.d[v];
        }
        if (change < SETTLED || fit->model->no_vision)
            break;
    }
    integrate(fit);
}

/* Beyond the picture's luminances the curve stays level, but colours are treated as at its ends. */
static void extend(const struct fit *fit, struct m08_curve *out)
{
    double rise[M08_SEGMENTS] = {0};

    for (int s = fit->low; s < fit->high; s++)
        rise[s] = (fit->y[s + 1] - fit->y[s]) / M08_STEP;
    for (int node = 0; node < M08_NODES; node++) {
        int at = node < fit->low ? fit->low : node > fit->high ? fit->high : node;
        int below = at > fit->low ? at - 1 : at, above = at < fit->high ? at : at - 1;

        out->y[node] = fit->y[at];
        out->slope[node] = 0.5 * (rise[below] + rise[above]);
    }
}

status m08_curve_fit(struct m08_curve *out, const struct m08_contrasts *contrasts, const struct m08_model *model,
                     struct error *err)
{
    struct fit *fit = mem_calloc(1, sizeof *fit);
    status st;

    memset(out, 0, sizeof *out);
    NEED(fit, err, "a tone curve");
    fit->contrasts = contrasts;
    fit->model = model;
    fit->y_min = det_log_d(m08_display_light(model->display, 0.0)) * M08_INV_LN10;
    fit->y_max = det_log_d(m08_display_light(model->display, 1.0)) * M08_INV_LN10;
    tabulate_sensitivity(fit);
    st = set_up(fit, err);
    if (st == STATUS_OK && fit->count > 0) {
        iterate(fit);
        extend(fit, out);
    } else {
        for (int node = 0; node < M08_NODES; node++)
            out->y[node] = fit->y_max; /* no contrast at all: only hard edges */
    }
    mem_free(fit->equations);
    mem_free(fit);
    return st;
}
