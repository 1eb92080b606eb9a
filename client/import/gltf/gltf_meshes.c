/* Meshes: each primitive becomes one mesh of the scene, for each way in which nodes use it. */
#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf_mesh_parts.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

enum primitive_mode { MODE_TRIANGLES = 4, MODE_STRIP = 5, MODE_FAN = 6 };

static status read_positions(struct gltf *g, json_t *attributes, const struct gltf_place *at, struct mesh_source *mesh)
{
    struct gltf_accessor accessor;
    int64_t index = -1;

    TRY(gltf_index(g, attributes, at, "POSITION", g->accessors, &index));
    if (index < 0)
        return STATUS_OK;
    TRY(gltf_accessor_open(g, (size_t)index, &accessor));
    if (accessor.components != 3)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "POSITION must have 3 components, it has %d", accessor.components);
    TRY(gltf_accessor_floats(g, (size_t)index, &accessor, 0, &mesh->positions));
    mesh->vertex_count = accessor.count;
    for (size_t i = 0; i < mesh->vertex_count * 3; i++) {
        /* No negative zero, so that equal positions have equal bits. */
        mesh->positions[i] += 0.0f;
        if (fabsf(mesh->positions[i]) > SCENE_COORDINATE_MAX)
            return gltf_fail(g, STATUS_ERR_INPUT, at, "POSITION %zu lies beyond 1e15 metres", i / 3);
    }
    return STATUS_OK;
}

/* COLOR_0 as RGBA 0..1; left out when it changes nothing. */
static status read_colors(struct gltf *g, json_t *attributes, const struct gltf_place *at, const char *name,
                          struct mesh_source *mesh)
{
    float *raw = NULL;
    int components = 0, acts = 0;
    float range;

    TRY(gltf_attribute(g, attributes, at, "COLOR_0", 3, 4, 0, mesh->vertex_count, &raw, &components));
    if (!raw)
        return STATUS_OK;
    range = mesh_color_range(raw, mesh->vertex_count * (size_t)components);
    if (range > 1)
        builder_warn(g->b, "vertex color range",
                     "%s[%zu]%s of \"%.80s\": COLOR_0 goes up to %g but is not marked as normalized: read as if it were",
                     at->table, at->row, at->part, name, (double)range);
    for (size_t i = 0; i < mesh->vertex_count * (size_t)components; i++) {
        raw[i] = fminf(fmaxf(raw[i] / range, 0.0f), 1.0f) + 0.0f;
        acts |= raw[i] != 1;
    }
    if (acts) {
        mesh->colors = must(mem_alloc_array(mesh->vertex_count, 4 * sizeof *mesh->colors));
        for (size_t v = 0; v < mesh->vertex_count; v++)
            for (size_t c = 0; c < 4; c++)
                mesh->colors[4 * v + c] = (int)c < components ? raw[v * (size_t)components + c] : 1.0f;
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

/* One tangent serves all uses: that of the normal map if there is one, else of the coat's, else of
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
        if (a->uv_transform[r][0] != b->uv_transform[r][0] || a->uv_transform[r][1] != b->uv_transform[r][1])
            return 0;
    return a->uv_set == b->uv_set;
}

static void warn_of_axes(struct gltf *g, const struct scene_material *m)
{
    if (m->normal_texture.texture >= 0 && m->clearcoat_normal_texture.texture >= 0 &&
        !same_axes(&m->normal_texture, &m->clearcoat_normal_texture))
        builder_warn(g->b, "two tangents",
                     "material \"%.80s\": its clearcoat's normal map has other texture axes than "
                     "its own: the axes of its own are used for both",
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

static status read_triangles(struct gltf *g, json_t *primitive, const struct gltf_place *at, uint64_t mode,
                             struct mesh_source *mesh)
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
                status result = gltf_fail(g, STATUS_ERR_INPUT, at, "index %zu is %u, but there are %zu vertices", i,
                                          list[i], mesh->vertex_count);
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
    mesh->indices = must(mem_alloc_array(mesh->triangle_count, 3 * sizeof *mesh->indices));
    for (size_t t = 0; t < mesh->triangle_count; t++)
        for (size_t c = 0; c < 3; c++) {
            size_t i = corner(mode, t, c);
            mesh->indices[3 * t + c] = list ? list[i] : (uint32_t)i;
        }
    mem_free(list);
    return STATUS_OK;
}

/* ---- variants ------------------------------------------------------------------------------ */

/* The material that the chosen variant gives the primitive; *material is unchanged if it gives none. */
static status choose_material(struct gltf *g, json_t *primitive, const struct gltf_place *at, int64_t *material)
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

/* ---- primitives ---------------------------------------------------------------------------- */

static status read_source(struct gltf *g, json_t *primitive, json_t *attributes, const struct gltf_place *at,
                          const char *name, uint64_t mode, const struct scene_material *material,
                          const struct mesh_tangents *tangents, struct mesh_source *mesh)
{
    const struct gltf_place inner = gltf_within(at, ".attributes");

    TRY(read_positions(g, attributes, &inner, mesh));
    if (!mesh->positions)
        return STATUS_OK;
    TRY(read_triangles(g, primitive, at, mode, mesh));
    TRY(gltf_attribute(g, attributes, &inner, "NORMAL", 3, 3, 1, mesh->vertex_count, &mesh->normals, NULL));
    if (tangents->wanted && mesh->normals)
        TRY(gltf_attribute(g, attributes, &inner, "TANGENT", 4, 4, 1, mesh->vertex_count, &mesh->tangents, NULL));
    for (uint32_t set = 0; set < 2; set++) {
        int for_tangents = tangents->wanted && tangents->uv_set == set && !mesh->tangents;
        if (!uses_uv(material, set) && !for_tangents)
            continue;
        TRY(gltf_attribute(g, attributes, &inner, set ? "TEXCOORD_1" : "TEXCOORD_0", 2, 2, 0, mesh->vertex_count,
                           &mesh->uv[set], NULL));
        if (!mesh->uv[set] && uses_uv(material, set))
            builder_warn(g->b, "texture coordinates",
                         "%s[%zu]%s: its material uses TEXCOORD_%u, which the mesh does not have: "
                         "(0, 0) is used",
                         at->table, at->row, at->part, set);
    }
    return read_colors(g, attributes, &inner, name, mesh);
}

/* What moves the vertices. */
static status read_deformation(struct gltf *g, json_t *primitive, json_t *attributes, const struct gltf_place *at,
                               const struct gltf_mesh *use, struct mesh_source *mesh, struct gltf_primitive *out)
{
    const struct gltf_place inner = gltf_within(at, ".attributes");

    TRY(gltf_targets_read(g, primitive, at, use->weight_count, mesh));
    if (!use->morphing)
        TRY(gltf_targets_bake(g, at, use->weights, mesh));
    if (use->skinned)
        TRY(gltf_skin_read(g, attributes, &inner, mesh, &out->joint_max));
    return STATUS_OK;
}

static status read_primitive(struct gltf *g, json_t *primitive, const struct gltf_place *at, const char *name,
                             const struct gltf_mesh *use, struct gltf_primitive *out)
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
        return gltf_fail(g, STATUS_ERR_INPUT, at, "mode %llu is unknown: 0 to 6 are", (unsigned long long)mode);
    if (mode < MODE_TRIANGLES) {
        builder_warn(g->b, mode == 0 ? "points" : "lines", "%s[%zu]%s: is made of %s, which are not rendered",
                     at->table, at->row, at->part, mode == 0 ? "points" : "lines");
        return STATUS_OK;
    }
    if (!attributes)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "has no attributes");
    TRY(gltf_material(g, material, &material_row));
    tangents = tangents_of(&g->b->materials[material_row]);
    warn_of_axes(g, &g->b->materials[material_row]);
    result = gltf_draco_read(g, primitive, attributes, at, mode);
    THEN(result, read_source(g, primitive, attributes, at, name, mode, &g->b->materials[material_row], &tangents, &mesh));
    if (result == STATUS_OK && mesh.positions)
        result = read_deformation(g, primitive, attributes, at, use, &mesh, out);
    if (result == STATUS_OK && !mesh.positions) {
        builder_warn(g->b, "no positions", "%s[%zu]%s: has no POSITION: left out", at->table, at->row, at->part);
    } else if (result == STATUS_OK) {
        result = mesh_finish(g->b, &mesh, name, &tangents, &out->mesh);
        out->material = material_row;
    }
    gltf_draco_release(g, primitive, attributes);
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

static struct gltf_mesh *add_use(struct gltf *g, size_t index, const struct gltf_use *use, size_t primitive_count)
{
    struct gltf_mesh *mesh = must(mem_calloc(1, sizeof *mesh));

    mesh->next = g->mesh_data[index];
    g->mesh_data[index] = mesh; /* from here on freed with the others */
    mesh->skinned = use->skinned;
    mesh->morphing = use->morphing;
    mesh->weight_count = use->weight_count;
    mesh->primitives = must(mem_calloc(primitive_count, sizeof *mesh->primitives));
    if (use->weight_count)
        mesh->weights = must(mem_memdup(use->weights, use->weight_count * sizeof *use->weights));
    mesh->count = primitive_count;
    return mesh;
}

status gltf_mesh(struct gltf *g, size_t index, const struct gltf_use *use, const struct gltf_mesh **out)
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
    for (size_t i = 0; i < mesh->count; i++) {
        const struct gltf_place inner = gltf_within(&at, ".primitives[%zu]", i);
        TRY(read_primitive(g, json_array_get(primitives, i), &inner, name, mesh, &mesh->primitives[i]));
    }
    return STATUS_OK;
}
