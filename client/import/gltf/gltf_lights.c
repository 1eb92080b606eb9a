/* glTF: the lights of KHR_lights_punctual, and their units. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "common/math/elementary.h"

/* ---- units -------------------------------------------------------------------------------- */

/* If Blender wrote the file, its candela and lux are photometric (683 lm/W); most viewers, and we
 * if the exporter is unknown, read the numbers as W/sr and W/m^2. */
#define LUMENS_PER_WATT 683.0
#define BLENDER_GENERATOR "Khronos glTF Blender I/O v"

enum light_units { UNITS_RADIOMETRIC, UNITS_PHOTOMETRIC, UNITS_WATTS };

/* Did Blender's exporter write the file, and did it know photometric units? It writes them unless
 * asked otherwise from version 3.4 on; before it wrote a lamp's watts. */
static int is_blenders(const struct gltf *g, enum light_units *units)
{
    const char *generator = json_string_value(json_object_get(json_object_get(g->root, "asset"), "generator"));
    unsigned major = 0, minor = 0;

    if (!generator || strncmp(generator, BLENDER_GENERATOR, strlen(BLENDER_GENERATOR)) != 0)
        return 0;
    if (sscanf(generator + strlen(BLENDER_GENERATOR), "%3u.%3u", &major, &minor) != 2)
        return 0;
    *units = major > 3 || (major == 3 && minor >= 4) ? UNITS_PHOTOMETRIC : UNITS_WATTS;
    return 1;
}

static enum light_units units_of(struct gltf *g, const char *word)
{
    enum light_units units = UNITS_RADIOMETRIC;
    int blenders = is_blenders(g, &units);

    if (blenders) {
        g->b->no_camera_hint = "; in Blender's exporter tick Include > Cameras";
        g->b->no_light_hint = "; in Blender's exporter tick Include > Punctual Lights";
    }
    if (strcmp(word, "photometric") == 0)
        return UNITS_PHOTOMETRIC;
    if (strcmp(word, "watts") == 0)
        return UNITS_WATTS;
    if (strcmp(word, "radiometric") == 0)
        return UNITS_RADIOMETRIC;
    if (blenders && json_array_size(g->lights))
        builder_warn(g->b, "light units",
                     units == UNITS_PHOTOMETRIC
                         ? "Blender wrote the lights in candela and lux: divided by 683 lm/W "
                           "(exported as \"Unitless\", they need --light-units radiometric)"
                         : "Blender before 3.4 wrote the lights' watts: points and spots divided "
                           "by 4 pi (--light-units radiometric takes them as W/sr)");
    return units;
}

void gltf_light_units(struct gltf *g, const char *word)
{
    enum light_units units = units_of(g, word);
    double spread = units == UNITS_WATTS         ? 1 / (4 * PI_D)
                    : units == UNITS_PHOTOMETRIC ? 1 / LUMENS_PER_WATT
                                                 : 1;

    g->light_scale[LIGHT_POINT] = g->light_scale[LIGHT_SPOT] = spread;
    g->light_scale[LIGHT_DIRECTIONAL] = units == UNITS_PHOTOMETRIC ? 1 / LUMENS_PER_WATT : 1;
}

/* ---- lights ------------------------------------------------------------------------------- */

/* glTF's rim is the square of a ramp; an extra says that it is Blender's and pbrt's smooth step.
 * Extras may contain anything: other values are ignored. */
static enum scene_falloff read_falloff(json_t *light)
{
    const char *word = json_string_value(json_object_get(json_object_get(light, "extras"), "falloff"));

    return word && strcmp(word, "smoothstep") == 0 ? FALLOFF_SMOOTHSTEP : FALLOFF_GLTF;
}

static status read_spot(struct gltf *g, json_t *light, const struct gltf_place *at, struct scene_light *out)
{
    const struct gltf_place inner = gltf_within(at, ".spot");
    double cone_inner = 0, cone_outer = 0.78539816339744830962;
    json_t *spot = NULL;

    TRY(gltf_object(g, light, at, "spot", &spot));
    TRY(gltf_number(g, spot, &inner, "innerConeAngle", &cone_inner));
    TRY(gltf_number(g, spot, &inner, "outerConeAngle", &cone_outer));
    if (!(cone_outer > 0 && cone_outer <= 1.5707964) || cone_inner < 0 ||
        cone_inner >= cone_outer) {
        builder_warn(g->b, "spot cone",
                     "lights[%zu]: a spot's angles must be 0 <= inner < outer <= pi/2, they are %g "
                     "and %g: brought into range",
                     at->row, cone_inner, cone_outer);
        cone_outer = fmin(fmax(cone_outer, 1e-3), 1.5707963);
        cone_inner = fmin(fmax(cone_inner, 0), cone_outer * 0.999);
    }
    out->falloff = read_falloff(light);
    out->inner_cone_rad = (float)cone_inner;
    out->outer_cone_rad = (float)cone_outer;
    /* Rounding to float must not turn a very narrow edge into a hard one. */
    if (!(out->inner_cone_rad < out->outer_cone_rad))
        out->inner_cone_rad = out->outer_cone_rad * 0.999f;
    return STATUS_OK;
}

status gltf_light(struct gltf *g, size_t index, const char *node_name, const struct transform_d *to_world,
                  struct scene_light *out)
{
    const struct gltf_place at = gltf_at("lights", index, "");
    double color[3] = {1, 1, 1}, intensity = 1, range = 0, direction[3], length = 0;
    const char *type = "", *name = "";
    int is_light = 1;
    json_t *light;

    scene_light_default(out);
    out->direction[2] = 0;
    TRY(gltf_row(g, g->lights, &at, &light));
    TRY(gltf_text(g, light, &at, "type", &type));
    TRY(gltf_text(g, light, &at, "name", &name));
    TRY(gltf_numbers(g, light, &at, "color", 3, color));
    TRY(gltf_number(g, light, &at, "intensity", &intensity));
    TRY(gltf_number(g, light, &at, "range", &range));
    if (strcmp(type, "point") == 0) {
        out->kind = LIGHT_POINT;
    } else if (strcmp(type, "spot") == 0) {
        out->kind = LIGHT_SPOT;
        TRY(read_spot(g, light, &at, out));
    } else if (strcmp(type, "directional") == 0) {
        out->kind = LIGHT_DIRECTIONAL;
    } else {
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "type \"%.32s\" is unknown: point, spot and directional are known",
                         type);
    }
    if (!(range >= 0))
        builder_warn(g->b, "light range", "lights[%zu]: the range %g is not above 0: it has none", index, range);
    /* Some write the largest float where there is none. */
    out->range = out->kind != LIGHT_DIRECTIONAL && range > 0 && range <= (double)SCENE_COORDINATE_MAX ? (float)range : 0;
    for (int c = 0; c < 3; c++)
        is_light &= color[c] * intensity >= 0;
    if (!is_light)
        builder_warn(g->b, "light intensity", "lights[%zu]: color times intensity must be 0 or more: it does not shine", index);
    for (int c = 0; c < 3; c++) {
        double value = is_light ? color[c] * intensity * g->light_scale[out->kind] : 0;
        if (!(value <= (double)SCENE_RADIANCE_MAX))
            return gltf_fail(g, STATUS_ERR_INPUT, &at, "color times intensity must be at most %g", (double)SCENE_RADIANCE_MAX);
        out->intensity[c] = (float)value;
        out->position[c] = to_world->m[c][3];
        /* Along the node's -Z. The node's scale changes neither intensity nor range. */
        direction[c] = -to_world->m[c][2];
        length = fmax(length, fabs(direction[c]));
    }
    if (!(length > 0) || !isfinite(length)) {
        builder_warn(g->b, "light direction", "lights[%zu]: its node has no direction: it shines along -Z", index);
        out->direction[2] = -1;
    } else {
        double norm = 0;
        for (int c = 0; c < 3; c++)
            norm += direction[c] / length * (direction[c] / length);
        for (int c = 0; c < 3; c++)
            out->direction[c] = (float)(direction[c] / length / sqrt(norm));
    }
    out->name = builder_name(g->b, *name ? name : node_name);
    return STATUS_OK;
}
