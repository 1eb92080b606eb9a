/* What the faces of a PLY file say of their corners: texture coordinates of each, or one colour for all. */
#include <string.h>

#include "client/import/ply/ply_parts.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

/* The key of a vertex; compared byte by byte. */
struct corner_key {
    uint32_t vertex;
    float uv[2], color[4];
};

/* Let the list have `count` values; new ones are `value`. */
static void list_fill(struct ply_list *list, size_t count, float value)
{
    MUST_GROW(list->values, list->capacity, count);
    while (list->count < count)
        list->values[list->count++] = value;
    list->count = count;
}

status ply_texcoords_read(struct ply *p, const struct property *property, size_t first_corner)
{
    size_t count;

    TRY(ply_list_size(p, property, &count));
    list_fill(&p->corner_uv, 2 * first_corner, 0);
    list_fill(&p->corner_uv, 2 * first_corner + count, 0);
    for (size_t i = 0; i < count; i++) {
        double value;
        TRY(ply_value_read(p, property->type, &value));
        p->corner_uv.values[2 * first_corner + i] = ply_finite(value);
    }
    return STATUS_OK;
}

void ply_texcoords_end(struct ply *p)
{
    if (p->corner_uv.count == 2 * p->corner_count)
        return;
    p->report.texcoords_odd += p->corner_uv.count > 0;
    list_fill(&p->corner_uv, 2 * p->corner_count, 0);
}

void ply_face_color_add(struct ply *p, const float color[4])
{
    list_fill(&p->face_colors, 4 * (p->face_count - 1), 1);
    list_fill(&p->face_colors, 4 * p->face_count, 1);
    memcpy(p->face_colors.values + 4 * (p->face_count - 1), color, 4 * sizeof *color);
}

static struct corner_key *make_keys(const struct ply *p)
{
    struct corner_key *keys = must(mem_calloc(p->corner_count, sizeof *keys));
    size_t corner = 0;

    for (size_t f = 0; f < p->face_count; f++)
        for (uint32_t i = 0; i < p->sizes[f]; i++, corner++) {
            keys[corner].vertex = p->corners[corner];
            if (2 * corner + 1 < p->corner_uv.count)
                memcpy(keys[corner].uv, p->corner_uv.values + 2 * corner, sizeof keys->uv);
            for (size_t c = 0; c < 4; c++)
                keys[corner].color[c] = 4 * f + c < p->face_colors.count ? p->face_colors.values[4 * f + c] : 1;
        }
    return keys;
}

static void give_attributes(struct ply *p, const struct corner_key *keys, const uint32_t *corner_of, size_t count)
{
    struct mesh_source *out = p->out;

    if (p->corner_uv.count) {
        mem_free(out->uv[0]);
        out->uv[0] = must(mem_alloc_array(count, sizeof keys->uv));
    }
    if (p->face_colors.count)
        out->colors = must(mem_alloc_array(count, sizeof keys->color));
    for (size_t v = 0; v < count; v++) {
        if (p->corner_uv.count)
            memcpy(out->uv[0] + 2 * v, keys[corner_of[v]].uv, sizeof keys->uv);
        if (p->face_colors.count)
            memcpy(out->colors + 4 * v, keys[corner_of[v]].color, sizeof keys->color);
    }
}

status ply_corners_split(struct ply *p)
{
    struct corner_key *keys;
    uint32_t *weld, *corner_of, *from;
    size_t count = 0;

    if (p->out->colors && p->face_colors.count) {
        p->report.face_colors_unread = 1;
        p->face_colors.count = 0;
    }
    if (p->corner_count == 0 || p->corner_uv.count + p->face_colors.count == 0)
        return STATUS_OK;
    if (p->corner_count >= UINT32_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "has %zu corners: too many", p->corner_count);
    keys = make_keys(p);
    weld = must(mem_alloc_array(p->corner_count, sizeof *weld));
    corner_of = must(mem_alloc_array(p->corner_count, sizeof *corner_of));
    from = must(mem_alloc_array(p->corner_count, sizeof *from));
    vertices_weld(keys, sizeof *keys, p->corner_count, weld);
    for (size_t i = 0; i < p->corner_count; i++) {
        if (p->corners[i] >= p->out->vertex_count) {
            p->corners[i] = weld[i] = UINT32_MAX;
            continue;
        }
        if (weld[i] == i) {
            corner_of[count] = (uint32_t)i;
            from[count] = p->corners[i];
            weld[i] = (uint32_t)count++;
        } else {
            weld[i] = weld[weld[i]]; /* the first of them already has its number */
        }
        p->corners[i] = weld[i];
    }
    mesh_source_gather(p->out, from, count);
    give_attributes(p, keys, corner_of, count);
    mem_free(keys);
    mem_free(weld);
    mem_free(corner_of);
    mem_free(from);
    return STATUS_OK;
}
