/* What moves the vertices of a mesh: morph targets and skins. */
#include <math.h>

#include "client/import/gltf/gltf_mesh_parts.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/base/safeguard.h"

/* ---- morph targets -------------------------------------------------------------------------- */

size_t gltf_target_count(const struct gltf *g, size_t mesh)
{
    json_t *primitives = json_object_get(json_array_get(g->meshes, mesh), "primitives");

    return json_array_size(json_object_get(json_array_get(primitives, 0), "targets"));
}

static status read_offsets(struct gltf *g, json_t *target, const struct gltf_place *at, const char *key,
                           size_t vertices, float **out)
{
    TRY(gltf_attribute(g, target, at, key, 3, 3, 0, vertices, out, NULL));
    if (*out)
        for (size_t i = 0; i < vertices * 3; i++)
            if (fabsf((*out)[i]) > SCENE_COORDINATE_MAX)
                return gltf_fail(g, STATUS_ERR_INPUT, at, "%s %zu lies beyond 1e15 metres", key, i / 3);
    return STATUS_OK;
}

/* Offsets of positions and normals. Offsets of tangents are not kept: the renderer transforms the
 * rest shape's tangents. */
static status read_target(struct gltf *g, json_t *target, const struct gltf_place *at, const struct mesh_source *mesh,
                          struct mesh_morph *out)
{
    if (!json_is_object(target))
        return gltf_fail(g, STATUS_ERR_INPUT, at, "must be an object");
    TRY(read_offsets(g, target, at, "POSITION", mesh->vertex_count, &out->positions));
    if (mesh->normals)
        TRY(read_offsets(g, target, at, "NORMAL", mesh->vertex_count, &out->normals));
    if (!out->positions)
        out->positions = must(mem_calloc(mesh->vertex_count, 3 * sizeof *out->positions));
    return STATUS_OK;
}

status gltf_targets_read(struct gltf *g, json_t *primitive, const struct gltf_place *at, size_t wanted,
                         struct mesh_source *mesh)
{
    json_t *targets = NULL;
    size_t count;

    TRY(gltf_array(g, primitive, at, "targets", &targets));
    count = json_array_size(targets);
    if (count != wanted)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "has %zu morph targets, but the mesh's first primitive has %zu",
                         count, wanted);
    if (count == 0)
        return STATUS_OK;
    if (count > SCENE_MORPHS_MAX || count * mesh->vertex_count > GLTF_MORPHED_VERTICES_MAX)
        return gltf_fail(g, STATUS_ERR_LIMIT, at,
                         "has %zu morph targets of %zu vertices: at most %d of together %d "
                         "vertices are taken",
                         count, mesh->vertex_count, SCENE_MORPHS_MAX, GLTF_MORPHED_VERTICES_MAX);
    mesh->morphs = must(mem_calloc(count, sizeof *mesh->morphs));
    mesh->morph_count = count;
    for (size_t i = 0; i < count; i++) {
        const struct gltf_place inner = gltf_within(at, ".targets[%zu]", i);
        TRY(read_target(g, json_array_get(targets, i), &inner, mesh, &mesh->morphs[i]));
    }
    return STATUS_OK;
}

status gltf_targets_bake(struct gltf *g, const struct gltf_place *at, const float *weights, struct mesh_source *mesh)
{
    for (size_t m = 0; m < mesh->morph_count; m++) {
        struct mesh_morph *morph = &mesh->morphs[m];
        for (size_t i = 0; weights[m] != 0 && i < mesh->vertex_count * 3; i++) {
            mesh->positions[i] += weights[m] * morph->positions[i];
            if (morph->normals)
                mesh->normals[i] += weights[m] * morph->normals[i];
        }
        mem_free(morph->positions);
        mem_free(morph->normals);
    }
    mem_free(mesh->morphs);
    mesh->morphs = NULL;
    mesh->morph_count = 0;
    for (size_t i = 0; i < mesh->vertex_count * 3; i++)
        if (!(fabsf(mesh->positions[i]) <= SCENE_COORDINATE_MAX))
            return gltf_fail(g, STATUS_ERR_INPUT, at, "its morph weights move it beyond 1e15 metres");
    return STATUS_OK;
}

/* ---- skins ---------------------------------------------------------------------------------- */

/* One set (JOINTS_n, WEIGHTS_n): [vertices][4] each. */
struct influence_set {
    float *joints, *weights;
};

static status read_set(struct gltf *g, json_t *attributes, const struct gltf_place *at, int set, size_t vertices,
                       struct influence_set *out)
{
    char joints[16], weights[16];

    snprintf(joints, sizeof joints, "JOINTS_%d", set);
    snprintf(weights, sizeof weights, "WEIGHTS_%d", set);
    TRY(gltf_attribute(g, attributes, at, joints, 4, 4, 0, vertices, &out->joints, NULL));
    TRY(gltf_attribute(g, attributes, at, weights, 4, 4, 0, vertices, &out->weights, NULL));
    if (!out->joints != !out->weights)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s and %s must come together", joints, weights);
    return STATUS_OK;
}

/* Make the weights add up to 1. Without any the vertex follows joint 0; 0 tells that. */
static int influence_normalize(struct mesh_influence *influence)
{
    double total = 0;

    for (int i = 0; i < 4; i++)
        total += (double)influence->weight[i];
    if (!SAFEGUARD(SKIN_WEIGHTS))
        return 1;
    if (!(total > 0)) {
        influence->weight[0] = 1;
        return 0;
    }
    for (int i = 0; i < 4; i++)
        influence->weight[i] = (float)((double)influence->weight[i] / total);
    return 1;
}

/* The four heaviest of up to eight, heaviest first, adding up to 1; *lost: others were left out;
 * *loose: there is none. */
static struct mesh_influence pick_influences(const struct influence_set *sets, int set_count, size_t v, int *lost,
                                             int *loose)
{
    struct mesh_influence out = {0};

    for (int k = 0; k < 4 * set_count; k++) {
        float weight = sets[k / 4].weights[4 * v + (size_t)k % 4];
        uint16_t joint = (uint16_t)sets[k / 4].joints[4 * v + (size_t)k % 4];
        int at = 4;
        if (!(weight > 0))
            continue;
        while (at > 0 && weight > out.weight[at - 1])
            at--;
        *lost |= at == 4 || out.weight[3] > 0;
        for (int i = 3; i > at; i--) {
            out.weight[i] = out.weight[i - 1];
            out.joint[i] = out.joint[i - 1];
        }
        if (at < 4) {
            out.weight[at] = weight;
            out.joint[at] = joint;
        }
    }
    *loose |= !influence_normalize(&out);
    return out;
}

status gltf_skin_read(struct gltf *g, json_t *attributes, const struct gltf_place *at, struct mesh_source *mesh,
                      uint32_t *joint_max)
{
    struct influence_set sets[2] = {{0}};
    int lost = 0, loose = 0, count;
    status result = read_set(g, attributes, at, 0, mesh->vertex_count, &sets[0]);

    THEN(result, read_set(g, attributes, at, 1, mesh->vertex_count, &sets[1]));
    if (result != STATUS_OK || !sets[0].joints)
        goto done;
    count = sets[1].joints ? 2 : 1;
    for (int s = 0; s < count && result == STATUS_OK; s++)
        for (size_t i = 0; i < mesh->vertex_count * 4; i++)
            if (!(sets[s].joints[i] >= 0 && sets[s].joints[i] < SCENE_JOINTS_MAX)) {
                result = gltf_fail(g, STATUS_ERR_INPUT, at, "JOINTS_%d %zu is no joint", s, i / 4);
                break;
            }
    if (result != STATUS_OK)
        goto done;
    mesh->influences = must(mem_alloc_array(mesh->vertex_count, sizeof *mesh->influences));
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        mesh->influences[v] = pick_influences(sets, count, v, &lost, &loose);
        for (int k = 0; k < 4; k++)
            if (mesh->influences[v].joint[k] > *joint_max)
                *joint_max = mesh->influences[v].joint[k];
    }
    if (lost)
        builder_warn(g->b, "more than four joints",
                     "%s[%zu]%s: more than four joints move a vertex: the four heaviest do", at->table, at->row,
                     at->part);
    if (loose)
        builder_warn(g->b, "loose vertices", "%s[%zu]%s: no joint moves a vertex: the skin's first does", at->table,
                     at->row, at->part);
done:
    for (int s = 0; s < 2; s++) {
        mem_free(sets[s].joints);
        mem_free(sets[s].weights);
    }
    return result;
}
