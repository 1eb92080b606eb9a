/* Motion: a pair of matrices becomes nodes with animated translation, rotation and scale. */
#include <math.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_motion.h"

int pbrt_polar(const struct transform_d *m, struct transform_d *rotation, double stretch[3][3])
{
    struct transform_d r = *m, inverse;

    for (int i = 0; i < 3; i++)
        r.m[i][3] = 0;
    for (int step = 0; step < 100; step++) {
        double change = 0;
        if (!transform_d_invert(&r, &inverse))
            return 0;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                double next = (r.m[i][j] + inverse.m[j][i]) / 2;
                change = fmax(change, fabs(next - r.m[i][j]));
                r.m[i][j] = next;
                if (!isfinite(next))
                    return 0;
            }
        /* The inverse above belongs to the previous matrix: do not use it below. */
        if (change < 1e-14)
            break;
    }
    if (transform_d_determinant(&r) < 0)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                r.m[i][j] = -r.m[i][j];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            stretch[i][j] = 0;
            for (int k = 0; k < 3; k++)
                stretch[i][j] += r.m[k][i] * m->m[k][j];
        }
    *rotation = r;
    return 1;
}

/* Shepperd 1978: from the largest of the four, so that nothing cancels. */
void pbrt_quaternion(const struct transform_d *r, double q[4])
{
    const double(*m)[4] = r->m;
    double trace = m[0][0] + m[1][1] + m[2][2];
    int largest = 3;
    double best = trace;

    for (int i = 0; i < 3; i++)
        if (m[i][i] > best)
            best = m[i][i], largest = i;
    if (largest == 3) {
        q[0] = m[2][1] - m[1][2];
        q[1] = m[0][2] - m[2][0];
        q[2] = m[1][0] - m[0][1];
        q[3] = 1 + trace;
    } else {
        const int i = largest, j = (i + 1) % 3, k = (i + 2) % 3;
        q[i] = 1 + 2 * m[i][i] - trace;
        q[j] = m[i][j] + m[j][i];
        q[k] = m[i][k] + m[k][i];
        q[3] = m[k][j] - m[j][k];
    }
    {
        double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        for (int i = 0; i < 4; i++)
            q[i] /= length;
    }
}

/* world = mirror * ctm: the mirror goes through the rotation into the stretch, which may be
 * negative: M R S = (M R M) (M S). */
static int pose_key_of(const struct pbrt *p, const struct transform_d *ctm, struct pbrt_pose_key *out)
{
    struct transform_d r;

    if (!pbrt_polar(ctm, &r, out->stretch))
        return 0;
    for (int i = 0; i < 3; i++)
        out->translation[i] = ctm->m[i][3];
    if (p->mirrored) {
        out->translation[2] = -out->translation[2];
        for (int i = 0; i < 2; i++) {
            r.m[i][2] = -r.m[i][2];
            r.m[2][i] = -r.m[2][i];
        }
        for (int j = 0; j < 3; j++)
            out->stretch[2][j] = -out->stretch[2][j];
    }
    pbrt_quaternion(&r, out->rotation);
    return 1;
}

int pbrt_stretch_is_diagonal(const double s[3][3])
{
    double largest = fmax(fabs(s[0][0]), fmax(fabs(s[1][1]), fabs(s[2][2]))), rest = 0;

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (i != j)
                rest = fmax(rest, fabs(s[i][j]));
    return rest <= 1e-6 * largest;
}

static status add_channel(struct pbrt *p, uint32_t node, enum scene_channel_path path, const double *first,
                          const double *second, uint32_t components)
{
    float times[2] = {(float)p->time_start, (float)p->time_end}, values[8];
    const struct scene_channel channel = {.node = node,
                                          .path = path,
                                          .interpolation = INTERPOLATE_LINEAR,
                                          .key_count = 2,
                                          .components = components,
                                          .times = times,
                                          .values = values};

    if (memcmp(first, second, components * sizeof *first) == 0)
        return STATUS_OK;
    for (uint32_t i = 0; i < components; i++) {
        values[i] = (float)first[i];
        values[components + i] = (float)second[i];
    }
    return builder_add_channel(p->b, &channel);
}

/* q and -q are one rotation: take the one next to the first key's. */
static void turn_the_shorter_way(struct pbrt_pose_key key[2])
{
    double dot = 0;

    for (int i = 0; i < 4; i++)
        dot += key[0].rotation[i] * key[1].rotation[i];
    for (int i = 0; i < 4 && dot < 0; i++)
        key[1].rotation[i] = -key[1].rotation[i];
}

status pbrt_add_key_nodes(struct pbrt *p, struct pbrt_pose_key key[2], int with_scale, uint32_t *row)
{
    struct scene_node place, node;
    const double still[3] = {0, 0, 0};
    double moved[3];
    uint32_t parent;

    turn_the_shorter_way(key);
    scene_node_default(&place);
    scene_node_default(&node);
    for (int i = 0; i < 3; i++) {
        place.translation[i] = key[0].translation[i];
        moved[i] = key[1].translation[i] - key[0].translation[i];
        node.scale[i] = with_scale ? key[0].stretch[i][i] : 1;
    }
    memcpy(node.rotation, key[0].rotation, sizeof node.rotation);
    TRY(builder_add_node(p->b, &place, &parent));
    node.parent = (int32_t)parent;
    TRY(builder_add_node(p->b, &node, row));
    TRY(add_channel(p, *row, PATH_TRANSLATION, still, moved, 3));
    return add_channel(p, *row, PATH_ROTATION, key[0].rotation, key[1].rotation, 4);
}

/* A constant stretch that is not a scale along the axes goes into a child node. */
static status add_stretch(struct pbrt *p, uint32_t parent, const double s[3][3], uint32_t *row)
{
    struct scene_node node = {.parent = (int32_t)parent, .has_matrix = 1};

    node.rotation[3] = 1;
    for (int i = 0; i < 3; i++) {
        node.scale[i] = 1;
        for (int j = 0; j < 3; j++)
            node.matrix.m[i][j] = s[i][j];
    }
    return builder_add_node(p->b, &node, row);
}

static status add_moving_node(struct pbrt *p, struct pbrt_pose_key key[2], const struct pbrt_place *at, uint32_t *row)
{
    int diagonal = pbrt_stretch_is_diagonal(key[0].stretch) && pbrt_stretch_is_diagonal(key[1].stretch);
    double near_enough = 0, scale[2][3];

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            near_enough = fmax(near_enough, fabs(key[0].stretch[i][j] - key[1].stretch[i][j]));
    if (near_enough < 1e-7) /* equal except for rounding */
        memcpy(key[1].stretch, key[0].stretch, sizeof key[0].stretch);
    else if (!diagonal)
        pbrt_warn(p, at, "animated shear", "a shear that changes with time is not supported: only the scale changes");
    if (!diagonal && near_enough >= 1e-7)
        diagonal = 1;
    TRY(pbrt_add_key_nodes(p, key, diagonal, row));
    if (!diagonal)
        return add_stretch(p, *row, key[0].stretch, row);
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 3; i++)
            scale[k][i] = key[k].stretch[i][i];
    return add_channel(p, *row, PATH_SCALE, scale[0], scale[1], 3);
}

status pbrt_node(struct pbrt *p, const struct pbrt_matrices *ctm, const struct pbrt_place *at, int32_t *out)
{
    struct pbrt_pose_key key[2];
    uint32_t row;

    *out = BUILDER_NO_ROW;
    if (!pbrt_is_moving(ctm))
        return STATUS_OK;
    if (p->last_node >= 0 && memcmp(&p->last_ctm, ctm, sizeof *ctm) == 0) {
        *out = (int32_t)p->last_node;
        return STATUS_OK;
    }
    for (int i = 0; i < 2; i++)
        if (!pose_key_of(p, &ctm->at[i], &key[i])) {
            pbrt_warn(p, at, "animated matrix", "an animated matrix cannot be inverted: rendered without its motion");
            return STATUS_OK;
        }
    TRY(add_moving_node(p, key, at, &row));
    p->is_animated = 1;
    p->last_node = row;
    p->last_ctm = *ctm;
    *out = (int32_t)row;
    return STATUS_OK;
}
