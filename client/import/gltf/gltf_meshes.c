#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "common/base/memory.h"
#include "common/base/safeguard.h"

enum primitive_mode { MODE_TRIANGLES = 4, MODE_STRIP = 5, MODE_FAN = 6 };

/* A vertex attribute as floats, [vertices][components]; *out stays NULL when absent. `most`
 * above `components` allows that many (COLOR_0); *found tells how many there are. */
static status read_attribute(struct gltf *g, json_t *attributes, const struct gltf_place *at,
                             const char *key, int components, int most, int any, size_t vertices,
                             float **out, int *found)
{
    struct gltf_accessor accessor;
    int64_t index = -1;

    TRY(gltf_index(g, attributes, at, key, g->accessors, &index));
    if (index < 0)
        return STATUS_OK;
    TRY(gltf_accessor_open(g, (size_t)index, &accessor));
    if (accessor.components < components || accessor.components > most)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s must have %d components, it has %d", key,
                         components, accessor.components);
    if (vertices && accessor.count != vertices)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s has %zu elements, POSITION has %zu", key,
                         accessor.count, vertices);
    if (found)
        *found = accessor.components;
    return gltf_accessor_floats(g, (size_t)index, &accessor, any, out);
}

static status read_positions(struct gltf *g, json_t *attributes, const struct gltf_place *at,
                             struct mesh_source *mesh)
{
    struct gltf_accessor accessor;
    int64_t index = -1;

    TRY(gltf_index(g, attributes, at, "POSITION", g->accessors, &index));
    if (index < 0)
        return STATUS_OK;
    TRY(gltf_accessor_open(g, (size_t)index, &accessor));
    if (accessor.components != 3)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "POSITION must have 3 components, it has %d",
                         accessor.components);
    TRY(gltf_accessor_floats(g, (size_t)index, &accessor, 0, &mesh->positions));
    mesh->vertex_count = accessor.count;
    for (size_t i = 0; i < mesh->vertex_count * 3; i++) {
        /* One zero only, so that equal positions are equal in their bits. */
        mesh->positions[i] += 0.0f;
        if (fabsf(mesh->positions[i]) > SCENE_COORDINATE_MAX)
            return gltf_fail(g, STATUS_ERR_INPUT, at, "POSITION %zu lies beyond 1e15 metres",
                             i / 3);
    }
    return STATUS_OK;
}

/* COLOR_0 as RGBA 0..1; left out when it changes nothing. */
static status read_colors(struct gltf *g, json_t *attributes, const struct gltf_place *at,
                          struct mesh_source *mesh)
{
    float *raw = NULL;
    int components = 0, acts = 0;

    TRY(read_attribute(g, attributes, at, "COLOR_0", 3, 4, 0, mesh->vertex_count, &raw,
                       &components));
    if (!raw)
        return STATUS_OK;
    for (size_t i = 0; i < mesh->vertex_count * (size_t)components; i++) {
        raw[i] = fminf(fmaxf(raw[i], 0.0f), 1.0f) + 0.0f;
        acts |= raw[i] != 1;
    }
    if (acts) {
        mesh->colors = mem_alloc_array(mesh->vertex_count, 4 * sizeof *mesh->colors);
        if (!mesh->colors) {
            mem_free(raw);
            return error_no_memory(g->err, "vertex colors");
        }
        for (size_t v = 0; v < mesh->vertex_count; v++)
            for (size_t c = 0; c < 4; c++)
                mesh->colors[4 * v + c] =
                    (int)c < components ? raw[v * (size_t)components + c] : 1.0f;
    }
    mem_free(raw);
    return STATUS_OK;
}

/* ---- what the material needs of the mesh --------------------------------------------------- */

static int uses_uv(const struct scene_material *m, uint32_t set)
{
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        if (m->textures[i].texture >= 0 && m->textures[i].uv_set == set)
            return 1;
    return 0;
}

/* One tangent serves all: that of the normal map if there is one, else of the coat's, else of
 * the anisotropy's texture, else of the first set. */
static struct mesh_tangents tangents_of(const struct scene_material *m)
{
    const struct scene_texture_slot *slot = &m->anisotropy_texture;
    int normal = m->normal_texture.texture >= 0 && m->normal_scale != 0;
    int coat = m->clearcoat_normal_texture.texture >= 0 && m->clearcoat_normal_scale != 0;
    struct mesh_tangents wanted = {0};

    wanted.wanted = normal || coat || m->anisotropy > 0;
    if (normal)
        slot = &m->normal_texture;
    else if (coat)
        slot = &m->clearcoat_normal_texture;
    wanted.uv_set = slot->uv_set;
    memcpy(wanted.uv_transform, slot->uv_transform, sizeof wanted.uv_transform);
    return wanted;
}

static int same_axes(const struct scene_texture_slot *a, const struct scene_texture_slot *b)
{
    for (int r = 0; r < 2; r++)
        if (a->uv_transform[r][0] != b->uv_transform[r][0] ||
            a->uv_transform[r][1] != b->uv_transform[r][1])
            return 0;
    return a->uv_set == b->uv_set;
}

static void warn_of_axes(struct gltf *g, const struct scene_material *m)
{
    if (m->normal_texture.texture >= 0 && m->clearcoat_normal_texture.texture >= 0 &&
        !same_axes(&m->normal_texture, &m->clearcoat_normal_texture))
        builder_warn(g->b, "two tangents",
                     "material \"%.80s\": its clearcoat's normal map lies otherwise on the mesh than "
                     "its own: the directions of its own are used for both",
                     m->name);
}

/* ---- indices ------------------------------------------------------------------------------- */

/* Corner `c` of triangle `t` in the order of the vertices of the primitive. */
static size_t corner(uint64_t mode, size_t t, size_t c)
{
    if (mode == MODE_TRIANGLES)
        return 3 * t + c;
    if (mode == MODE_STRIP) /* every other triangle turns round */
        return c == 0 ? t : t + (c == 1 ? 1 + t % 2 : 2 - t % 2);
    return c == 2 ? 0 : t + 1 + c;
}

static status read_triangles(struct gltf *g, json_t *primitive, const struct gltf_place *at,
                             uint64_t mode, struct mesh_source *mesh)
{
    struct gltf_accessor accessor;
    uint32_t *list = NULL;
    size_t count = mesh->vertex_count;
    int64_t index = -1;

    TRY(gltf_index(g, primitive, at, "indices", g->accessors, &index));
    if (index >= 0) {
        TRY(gltf_accessor_open(g, (size_t)index, &accessor));
        TRY(gltf_accessor_indices(g, (size_t)index, &accessor, &list));
        count = accessor.count;
        for (size_t i = 0; i < count; i++)
            if (list[i] >= mesh->vertex_count) {
                status result = gltf_fail(g, STATUS_ERR_INPUT, at,
                                          "index %zu is %u, but there are %zu vertices", i, list[i],
                                          mesh->vertex_count);
                mem_free(list);
                return result;
            }
    }
    if (mode == MODE_TRIANGLES && count % 3 != 0)
        builder_warn(g->b, "leftover vertices",
                     "%s[%zu]%s: has %zu vertices of triangles, not a multiple of 3: the last are "
                     "left out",
                     at->table, at->row, at->part, count);
    mesh->triangle_count = mode == MODE_TRIANGLES ? count / 3 : count < 3 ? 0 : count - 2;
    mesh->indices = mem_alloc_array(mesh->triangle_count, 3 * sizeof *mesh->indices);
    if (!mesh->indices) {
        mem_free(list);
        return error_no_memory(g->err, "triangles");
    }
    for (size_t t = 0; t < mesh->triangle_count; t++)
        for (size_t c = 0; c < 3; c++) {
            size_t i = corner(mode, t, c);
            mesh->indices[3 * t + c] = list ? list[i] : (uint32_t)i;
        }
    mem_free(list);
    return STATUS_OK;
}

/* ---- variants ------------------------------------------------------------------------------ */

/* The material that the chosen variant gives the primitive; *material stays when it gives
 * none. */
static status choose_material(struct gltf *g, json_t *primitive, const struct gltf_place *at,
                              int64_t *material)
{
    const struct gltf_place inner = gltf_within(at, ".KHR_materials_variants");
    json_t *extension = gltf_extension(primitive, "KHR_materials_variants"), *mappings = NULL;

    if (g->variant < 0 || !extension)
        return STATUS_OK;
    TRY(gltf_array(g, extension, &inner, "mappings", &mappings));
    for (size_t i = 0; i < json_array_size(mappings); i++) {
        json_t *mapping = json_array_get(mappings, i), *variants = NULL;
        TRY(gltf_array(g, mapping, &inner, "variants", &variants));
        for (size_t v = 0; v < json_array_size(variants); v++) {
            json_t *item = json_array_get(variants, v);
            if (json_is_integer(item) && json_integer_value(item) == g->variant)
                return gltf_index(g, mapping, &inner, "material", g->materials, material);
        }
    }
    return STATUS_OK;
}

/* ---- morph targets -------------------------------------------------------------------------- */

size_t gltf_target_count(const struct gltf *g, size_t mesh)
{
    json_t *primitives = json_object_get(json_array_get(g->meshes, mesh), "primitives");

    return json_array_size(json_object_get(json_array_get(primitives, 0), "targets"));
}

static status read_offsets(struct gltf *g, json_t *target, const struct gltf_place *at,
                           const char *key, size_t vertices, float **out)
{
    TRY(read_attribute(g, target, at, key, 3, 3, 0, vertices, out, NULL));
    if (*out)
        for (size_t i = 0; i < vertices * 3; i++)
            if (fabsf((*out)[i]) > SCENE_COORDINATE_MAX)
                return gltf_fail(g, STATUS_ERR_INPUT, at, "%s %zu lies beyond 1e15 metres", key,
                                 i / 3);
    return STATUS_OK;
}

/* Offsets of positions and normals; of tangents there are none to keep: the renderer carries
 * the rest shape's along. */
static status read_target(struct gltf *g, json_t *target, const struct gltf_place *at,
                          const struct mesh_source *mesh, struct mesh_morph *out)
{
    if (!json_is_object(target))
        return gltf_fail(g, STATUS_ERR_INPUT, at, "must be an object");
    if (json_object_get(target, "TEXCOORD_0") || json_object_get(target, "COLOR_0"))
        builder_warn(g->b, "morphed attributes",
                     "%s[%zu]%s: morphs texture coordinates or colors: only positions and normals "
                     "are morphed",
                     at->table, at->row, at->part);
    TRY(read_offsets(g, target, at, "POSITION", mesh->vertex_count, &out->positions));
    if (mesh->normals)
        TRY(read_offsets(g, target, at, "NORMAL", mesh->vertex_count, &out->normals));
    if (!out->positions)
        out->positions = mem_calloc(mesh->vertex_count, 3 * sizeof *out->positions);
    return out->positions ? STATUS_OK : error_no_memory(g->err, "a morph target");
}

static status read_targets(struct gltf *g, json_t *primitive, const struct gltf_place *at,
                           size_t wanted, struct mesh_source *mesh)
{
    json_t *targets = NULL;
    size_t count;

    TRY(gltf_array(g, primitive, at, "targets", &targets));
    count = json_array_size(targets);
    if (count != wanted)
        return gltf_fail(g, STATUS_ERR_INPUT, at,
                         "has %zu morph targets, but the mesh's first primitive has %zu", count,
                         wanted);
    if (count == 0)
        return STATUS_OK;
    if (count > SCENE_MORPHS_MAX || count * mesh->vertex_count > GLTF_MORPHED_VERTICES_MAX)
        return gltf_fail(g, STATUS_ERR_LIMIT, at,
                         "has %zu morph targets of %zu vertices: at most %d of together %d "
                         "vertices are taken",
                         count, mesh->vertex_count, SCENE_MORPHS_MAX, GLTF_MORPHED_VERTICES_MAX);
    mesh->morphs = mem_calloc(count, sizeof *mesh->morphs);
    if (!mesh->morphs)
        return error_no_memory(g->err, "morph targets");
    mesh->morph_count = count;
    for (size_t i = 0; i < count; i++) {
        const struct gltf_place inner = gltf_within(at, ".targets[%zu]", i);
        TRY(read_target(g, json_array_get(targets, i), &inner, mesh, &mesh->morphs[i]));
    }
    return STATUS_OK;
}

/* The shape that the weights make; the targets go. */
static status bake_targets(struct gltf *g, const struct gltf_place *at, const float *weights,
                           struct mesh_source *mesh)
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
            return gltf_fail(g, STATUS_ERR_INPUT, at,
                             "its morph weights move it beyond 1e15 metres");
    return STATUS_OK;
}

/* ---- skins ---------------------------------------------------------------------------------- */

/* What one set (JOINTS_n, WEIGHTS_n) says: [vertices][4] each. */
struct influence_set {
    float *joints, *weights;
};

static status read_set(struct gltf *g, json_t *attributes, const struct gltf_place *at, int set,
                       size_t vertices, struct influence_set *out)
{
    char joints[16], weights[16];

    snprintf(joints, sizeof joints, "JOINTS_%d", set);
    snprintf(weights, sizeof weights, "WEIGHTS_%d", set);
    TRY(read_attribute(g, attributes, at, joints, 4, 4, 0, vertices, &out->joints, NULL));
    TRY(read_attribute(g, attributes, at, weights, 4, 4, 0, vertices, &out->weights, NULL));
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

/* The four heaviest of up to eight, heaviest first, adding up to 1; *lost tells that others
 * were left out, *loose that there is none. */
static struct mesh_influence pick_influences(const struct influence_set *sets, int set_count,
                                             size_t v, int *lost, int *loose)
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

static status read_skin(struct gltf *g, json_t *attributes, const struct gltf_place *at,
                        struct mesh_source *mesh, uint32_t *joint_max)
{
    struct influence_set sets[2] = {{0}};
    int lost = 0, loose = 0, count;
    status result = read_set(g, attributes, at, 0, mesh->vertex_count, &sets[0]);

    if (result == STATUS_OK)
        result = read_set(g, attributes, at, 1, mesh->vertex_count, &sets[1]);
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
    mesh->influences = mem_alloc_array(mesh->vertex_count, sizeof *mesh->influences);
    if (!mesh->influences) {
        result = error_no_memory(g->err, "a skin");
        goto done;
    }
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        mesh->influences[v] = pick_influences(sets, count, v, &lost, &loose);
        for (int k = 0; k < 4; k++)
            if (mesh->influences[v].joint[k] > *joint_max)
                *joint_max = mesh->influences[v].joint[k];
    }
    if (lost)
        builder_warn(g->b, "more than four joints",
                     "%s[%zu]%s: more than four joints move a vertex: the four heaviest do",
                     at->table, at->row, at->part);
    if (loose)
        builder_warn(g->b, "loose vertices",
                     "%s[%zu]%s: no joint moves a vertex: the skin's first does", at->table,
                     at->row, at->part);
done:
    for (int s = 0; s < 2; s++) {
        mem_free(sets[s].joints);
        mem_free(sets[s].weights);
    }
    return result;
}

/* ---- primitives ---------------------------------------------------------------------------- */

static void warn_of_leftovers(struct gltf *g, json_t *attributes, const struct gltf_place *at)
{
    if (json_object_get(attributes, "COLOR_1"))
        builder_warn(g->b, "second vertex color",
                     "%s[%zu]%s: has more than one set of vertex colors: the first is used",
                     at->table, at->row, at->part);
    if (json_object_get(attributes, "JOINTS_2"))
        builder_warn(g->b, "third set of joints",
                     "%s[%zu]%s: has more than two sets of joints: the first two are read",
                     at->table, at->row, at->part);
}

static status check_compression(struct gltf *g, json_t *primitive, json_t *attributes,
                                const struct gltf_place *at)
{
    json_t *draco = gltf_extension(primitive, "KHR_draco_mesh_compression");
    json_t *position = json_object_get(attributes, "POSITION");
    json_t *accessor = json_array_get(g->accessors, (size_t)json_integer_value(position));

    /* An uncompressed copy may stand beside the compressed one. */
    if (draco && !json_object_get(accessor, "bufferView"))
        return gltf_fail(g, STATUS_ERR_UNSUPPORTED, at,
                         "is only there in Draco-compressed form: decompress the file first, for "
                         "example with \"gltf-transform copy in.glb out.glb\"");
    return STATUS_OK;
}

static status read_source(struct gltf *g, json_t *primitive, json_t *attributes,
                          const struct gltf_place *at, uint64_t mode,
                          const struct scene_material *material,
                          const struct mesh_tangents *tangents, struct mesh_source *mesh)
{
    const struct gltf_place inner = gltf_within(at, ".attributes");

    TRY(read_positions(g, attributes, &inner, mesh));
    if (!mesh->positions)
        return STATUS_OK;
    TRY(read_triangles(g, primitive, at, mode, mesh));
    TRY(read_attribute(g, attributes, &inner, "NORMAL", 3, 3, 1, mesh->vertex_count,
                       &mesh->normals, NULL));
    if (tangents->wanted && mesh->normals)
        TRY(read_attribute(g, attributes, &inner, "TANGENT", 4, 4, 1, mesh->vertex_count,
                           &mesh->tangents, NULL));
    for (uint32_t set = 0; set < 2; set++) {
        int for_tangents = tangents->wanted && tangents->uv_set == set && !mesh->tangents;
        if (!uses_uv(material, set) && !for_tangents)
            continue;
        TRY(read_attribute(g, attributes, &inner, set ? "TEXCOORD_1" : "TEXCOORD_0", 2, 2, 0,
                           mesh->vertex_count, &mesh->uv[set], NULL));
        if (!mesh->uv[set] && uses_uv(material, set))
            builder_warn(g->b, "texture coordinates",
                         "%s[%zu]%s: its material uses TEXCOORD_%u, which the mesh has not: (0, 0) "
                         "is used",
                         at->table, at->row, at->part, set);
    }
    return read_colors(g, attributes, &inner, mesh);
}

/* What moves the vertices. */
static status read_deformation(struct gltf *g, json_t *primitive, json_t *attributes,
                               const struct gltf_place *at, const struct gltf_mesh *use,
                               struct mesh_source *mesh, struct gltf_primitive *out)
{
    const struct gltf_place inner = gltf_within(at, ".attributes");

    TRY(read_targets(g, primitive, at, use->weight_count, mesh));
    if (!use->morphing)
        TRY(bake_targets(g, at, use->weights, mesh));
    if (use->skinned)
        TRY(read_skin(g, attributes, &inner, mesh, &out->joint_max));
    return STATUS_OK;
}

static status read_primitive(struct gltf *g, json_t *primitive, const struct gltf_place *at,
                             const char *name, const struct gltf_mesh *use,
                             struct gltf_primitive *out)
{
    struct mesh_source mesh = {0};
    struct mesh_tangents tangents;
    json_t *attributes = NULL;
    uint64_t mode = MODE_TRIANGLES;
    int64_t material = -1;
    uint32_t material_row;
    status result;

    out->mesh = BUILDER_NO_ROW;
    if (!json_is_object(primitive))
        return gltf_fail(g, STATUS_ERR_INPUT, at, "must be an object");
    TRY(gltf_size(g, primitive, at, "mode", &mode));
    TRY(gltf_object(g, primitive, at, "attributes", &attributes));
    TRY(gltf_index(g, primitive, at, "material", g->materials, &material));
    TRY(choose_material(g, primitive, at, &material));
    if (mode > MODE_FAN)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "mode %llu is unknown: 0 to 6 are",
                         (unsigned long long)mode);
    if (mode < MODE_TRIANGLES) {
        builder_warn(g->b, mode == 0 ? "points" : "lines",
                     "%s[%zu]%s: is made of %s, which are not rendered", at->table, at->row,
                     at->part, mode == 0 ? "points" : "lines");
        return STATUS_OK;
    }
    if (!attributes)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "has no attributes");
    TRY(check_compression(g, primitive, attributes, at));
    warn_of_leftovers(g, attributes, at);
    TRY(gltf_material(g, material, &material_row));
    tangents = tangents_of(&g->b->materials[material_row]);
    warn_of_axes(g, &g->b->materials[material_row]);
    result = read_source(g, primitive, attributes, at, mode, &g->b->materials[material_row],
                         &tangents, &mesh);
    if (result == STATUS_OK && mesh.positions)
        result = read_deformation(g, primitive, attributes, at, use, &mesh, out);
    if (result == STATUS_OK && !mesh.positions) {
        builder_warn(g->b, "no positions", "%s[%zu]%s: has no POSITION: left out", at->table,
                     at->row, at->part);
    } else if (result == STATUS_OK) {
        result = mesh_finish(g->b, &mesh, name, &tangents, &out->mesh);
        out->material = material_row;
    }
    mesh_source_release(&mesh);
    return result;
}

void gltf_mesh_free(struct gltf_mesh *mesh)
{
    while (mesh) {
        struct gltf_mesh *next = mesh->next;
        mem_free(mesh->weights);
        mem_free(mesh->primitives);
        mem_free(mesh);
        mesh = next;
    }
}

static int same_use(const struct gltf_mesh *mesh, const struct gltf_use *use)
{
    if (mesh->skinned != use->skinned || mesh->morphing != use->morphing)
        return 0;
    return mesh->morphing || mesh->weight_count == 0 ||
           memcmp(mesh->weights, use->weights, mesh->weight_count * sizeof *mesh->weights) == 0;
}

static struct gltf_mesh *add_use(struct gltf *g, size_t index, const struct gltf_use *use,
                                 size_t primitive_count)
{
    struct gltf_mesh *mesh = mem_calloc(1, sizeof *mesh);

    if (!mesh)
        return NULL;
    mesh->next = g->mesh_data[index];
    g->mesh_data[index] = mesh; /* from here on freed with the others */
    mesh->skinned = use->skinned;
    mesh->morphing = use->morphing;
    mesh->weight_count = use->weight_count;
    mesh->primitives = mem_calloc(primitive_count, sizeof *mesh->primitives);
    if (use->weight_count)
        mesh->weights = mem_memdup(use->weights, use->weight_count * sizeof *use->weights);
    if (!mesh->primitives || (use->weight_count && !mesh->weights))
        return NULL;
    mesh->count = primitive_count;
    return mesh;
}

status gltf_mesh(struct gltf *g, size_t index, const struct gltf_use *use,
                 const struct gltf_mesh **out)
{
    const struct gltf_place at = gltf_at("meshes", index, "");
    struct gltf_mesh *mesh = g->mesh_data[index];
    json_t *row, *primitives = NULL;
    const char *name = "";

    while (mesh && !same_use(mesh, use))
        mesh = mesh->next;
    *out = mesh;
    if (mesh)
        return STATUS_OK;
    TRY(gltf_row(g, g->meshes, &at, &row));
    TRY(gltf_text(g, row, &at, "name", &name));
    TRY(gltf_array(g, row, &at, "primitives", &primitives));
    if (json_array_size(primitives) == 0)
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "has no primitives");
    name = builder_name(g->b, name);
    *out = mesh = add_use(g, index, use, json_array_size(primitives));
    if (!mesh)
        return error_no_memory(g->err, "primitives");
    for (size_t i = 0; i < mesh->count; i++) {
        const struct gltf_place inner = gltf_within(&at, ".primitives[%zu]", i);
        TRY(read_primitive(g, json_array_get(primitives, i), &inner, name, mesh,
                           &mesh->primitives[i]));
    }
    return STATUS_OK;
}
