#include "common/scene/track.h"

#include <math.h>
#include <string.h>

#include "common/math/elementary.h"
#include "common/scene/pose.h"

/* ---- what can be animated ---------------------------------------------------------------------- */

enum { MESSAGE_STEP = 1024 }; /* above every number in a message */

static uint32_t code_of(enum material_message message, uint32_t number)
{
    return material_message_numbers[message] * MESSAGE_STEP + number;
}

uint32_t scene_track_value(enum material_value_number value)
{
    return code_of(material_values[value].message, material_values[value].number);
}

uint32_t scene_track_texture(enum material_texture slot)
{
    return code_of(material_textures[slot].message, material_textures[slot].number);
}

/* A value in its table. */
struct field {
    size_t offset;
    int count;
    float least, most;
};
#define HALF_PI 1.5707963f
static const struct field light_fields[] = {
    [TRACK_LIGHT_INTENSITY] = {offsetof(struct scene_light, intensity), 3, 0, SCENE_RADIANCE_MAX},
    [TRACK_LIGHT_RANGE] = {offsetof(struct scene_light, range), 1, 0, SCENE_COORDINATE_MAX},
    [TRACK_LIGHT_INNER_CONE] = {offsetof(struct scene_light, inner_cone_rad), 1, 0, HALF_PI},
    [TRACK_LIGHT_OUTER_CONE] = {offsetof(struct scene_light, outer_cone_rad), 1, 1e-3f, HALF_PI},
};
static const struct field camera_fields[] = {
    [TRACK_CAMERA_YFOV] = {offsetof(struct scene_camera, yfov_rad), 1, SCENE_FOV_MIN_RAD, SCENE_FOV_MAX_RAD},
    [TRACK_CAMERA_YMAG] = {offsetof(struct scene_camera, ymag), 1, 1e-12f, SCENE_COORDINATE_MAX},
};
enum { LIGHT_FIELDS = sizeof light_fields / sizeof *light_fields, CAMERA_FIELDS = sizeof camera_fields / sizeof *camera_fields };

static struct field material_field(uint32_t code)
{
    for (int i = 0; i < MATERIAL_VALUES; i++) {
        const struct material_value *row = &material_values[i];

        if (code_of(row->message, row->number) == code && material_is_float(row->type))
            return (struct field){row->offset, row->count, row->least, row->most};
    }
    return (struct field){0};
}

/* The texture's slot, -1: none. */
static int slot_of(uint32_t code)
{
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        if (scene_track_texture((enum material_texture)i) == code)
            return i;
    return -1;
}

static struct field texture_field(const struct scene_track *track)
{
    const float most = track->target == TRACK_UV_ROTATION ? 1e5f : 1e6f;

    return (struct field){0, slot_of(track->field) < 0 ? 0 : track->target == TRACK_UV_ROTATION ? 1 : 2, -most, most};
}

static struct field field_of(const struct scene_track *track)
{
    switch (track->target) {
    case TRACK_MATERIAL: return material_field(track->field);
    case TRACK_UV_SCALE:
    case TRACK_UV_ROTATION:
    case TRACK_UV_OFFSET: return texture_field(track);
    case TRACK_INSTANCE: return (struct field){0, track->field == 0, 0, 1};
    case TRACK_LIGHT: return track->field < LIGHT_FIELDS ? light_fields[track->field] : (struct field){0};
    case TRACK_CAMERA: return track->field < CAMERA_FIELDS ? camera_fields[track->field] : (struct field){0};
    case TRACK_TARGETS: break;
    }
    return (struct field){0};
}

int scene_track_count(const struct scene_track *track, float *least, float *most)
{
    const struct field field = field_of(track);

    *least = field.least;
    *most = field.most;
    return field.count;
}

int scene_track_compare(const struct scene_track *a, const struct scene_track *b)
{
    const uint32_t x[] = {(uint32_t)a->target, a->row, a->field, a->factor};
    const uint32_t y[] = {(uint32_t)b->target, b->row, b->field, b->factor};

    for (int i = 0; i < 4; i++)
        if (x[i] != y[i])
            return x[i] < y[i] ? -1 : 1;
    return 0;
}

int scene_tracks_change(const struct scene *scene, uint32_t camera)
{
    for (uint32_t i = 0; i < scene->track_count; i++) {
        const struct scene_track *track = &scene->tracks[i];

        if ((track->target != TRACK_CAMERA || track->row == camera) && !scene_channel_is_still(&track->keys))
            return 1;
    }
    return 0;
}

/* ---- a frame ----------------------------------------------------------------------------------- */

static float in_range(const struct field *field, double value)
{
    return (float)fmin(fmax(value, (double)field->least), (double)field->most);
}

static void set_numbers(const struct scene_track *track, double time_s, float *to)
{
    const struct field field = field_of(track);

    for (int i = 0; i < field.count; i++) {
        const double value = scene_channel_number(&track->keys, time_s, track->keys.components > 1 ? (uint32_t)i : 0);

        to[i] = in_range(&field, track->factor ? (double)to[i] * value : value);
    }
}

static float *number_at(void *row, const struct scene_track *track)
{
    return (float *)(void *)((char *)row + field_of(track).offset);
}

/* uv' = T R S uv, as an importer writes it. */
static void set_uv(const struct scene_track *track, double time_s, float m[2][3])
{
    float value[2] = {0, 0}, s, c;

    set_numbers(track, time_s, value);
    if (track->target == TRACK_UV_OFFSET) {
        m[0][2] = value[0];
        m[1][2] = value[1];
        return;
    }
    if (track->target == TRACK_UV_SCALE) {
        m[0][0] = value[0];
        m[1][1] = value[1];
        m[0][1] = m[1][0] = 0;
        return;
    }
    det_sincos(value[0], &s, &c);
    for (int k = 0; k < 2; k++) {
        const double x = (double)m[0][k], y = (double)m[1][k];

        m[0][k] = (float)((double)c * x + (double)s * y);
        m[1][k] = (float)((double)c * y - (double)s * x);
    }
}

/* To a point in its place; the rows of other tables that name it stay as they are. */
static void hide(struct scene_instance *instance)
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            instance->to_world.m[r][c] = 0;
    instance->node = instance->skin = -1;
}

static void apply(struct scene *scene, const struct scene_track *track, double time_s)
{
    float shown = 1;

    switch (track->target) {
    case TRACK_MATERIAL: set_numbers(track, time_s, number_at(&scene->materials[track->row], track)); break;
    case TRACK_UV_SCALE:
    case TRACK_UV_ROTATION:
    case TRACK_UV_OFFSET:
        set_uv(track, time_s, scene->materials[track->row].textures[slot_of(track->field)].uv_transform);
        break;
    case TRACK_INSTANCE:
        set_numbers(track, time_s, &shown);
        if (shown < 0.5f)
            hide(&scene->instances[track->row]);
        break;
    case TRACK_LIGHT: set_numbers(track, time_s, number_at(&scene->lights[track->row], track)); break;
    case TRACK_CAMERA: set_numbers(track, time_s, number_at(&scene->cameras[track->row], track)); break;
    case TRACK_TARGETS: break;
    }
}

/* A spot's edge must not become hard, and its cones must stay in order. */
static void mend_cones(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->light_count; i++) {
        struct scene_light *light = &scene->lights[i];

        if (light->kind == LIGHT_SPOT && !(light->inner_cone_rad < light->outer_cone_rad))
            light->inner_cone_rad = light->outer_cone_rad * 0.999f;
    }
}

static void *copied(struct arena *arena, const void *table, size_t count, size_t row_bytes)
{
    void *copy = arena_alloc(arena, count, row_bytes);

    if (copy && count > 0)
        memcpy(copy, table, count * row_bytes);
    return copy;
}

static int has_target(const struct scene *scene, enum scene_track_target first, enum scene_track_target last)
{
    for (uint32_t i = 0; i < scene->track_count; i++)
        if (scene->tracks[i].target >= first && scene->tracks[i].target <= last)
            return 1;
    return 0;
}

status scene_at_frame(struct scene *out, const struct scene *scene, const struct render_settings *settings,
                      uint32_t frame, struct error *err)
{
    const double time_s = scene_frame_s(settings, frame);

    *out = *scene;
    arena_init(&out->arena);
    if (scene->track_count == 0)
        return STATUS_OK;
#define COPY(table, count, first, last)                                                          \
    if (has_target(scene, first, last)) {                                                        \
        out->table = copied(&out->arena, scene->table, scene->count, sizeof *scene->table);      \
        NEED(out->table, err, "the scene in a frame");                                           \
    }
    COPY(materials, material_count, TRACK_MATERIAL, TRACK_UV_OFFSET)
    COPY(instances, instance_count, TRACK_INSTANCE, TRACK_INSTANCE)
    COPY(lights, light_count, TRACK_LIGHT, TRACK_LIGHT)
    COPY(cameras, camera_count, TRACK_CAMERA, TRACK_CAMERA)
#undef COPY
    for (uint32_t i = 0; i < scene->track_count; i++)
        apply(out, &scene->tracks[i], time_s);
    if (out->lights != scene->lights)
        mend_cones(out);
    out->track_count = 0;
    return STATUS_OK;
}
