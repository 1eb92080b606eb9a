/* A frame's layers for Cryptomatte: what is counted in the film, under the scene's names. */
#include "coordinator/pictures/develop_parts.h"

#define RANKS(layer) layer "00.R", layer "00.G", layer "00.B", layer "00.A", \
                     layer "01.R", layer "01.G", layer "01.B", layer "01.A", \
                     layer "02.R", layer "02.G", layer "02.B", layer "02.A"
#define NAMES(layer) {layer, "ViewLayer." layer}, {{RANKS(layer)}, {RANKS("ViewLayer." layer)}}

static const char *object_name(const void *scene, uint32_t thing)
{
    return ((const struct scene *)scene)->instances[thing].name;
}

static const char *material_name(const void *scene, uint32_t thing)
{
    return ((const struct scene *)scene)->materials[thing].name;
}

static const char *asset_name(const void *scene, uint32_t thing)
{
    const struct scene_instance *instance = &((const struct scene *)scene)->instances[thing];

    return *instance->asset ? instance->asset : instance->name;
}

static const struct {
    enum aov aov, counts; /* which is asked for; whose counts it is of */
    const char *kind;     /* of a thing without a name */
    const char *(*thing_name)(const void *scene, uint32_t thing);
    const char *types[EXR_NAMES_COUNT], *channels[EXR_NAMES_COUNT][CRYPTOMATTE_CHANNELS];
} rows[DEVELOPMENT_MATTES] = {
    {AOV_CRYPTO_OBJECT, AOV_CRYPTO_OBJECT, "object", object_name, NAMES("CryptoObject")},
    {AOV_CRYPTO_MATERIAL, AOV_CRYPTO_MATERIAL, "material", material_name, NAMES("CryptoMaterial")},
    {AOV_CRYPTO_ASSET, AOV_CRYPTO_OBJECT, "object", asset_name, NAMES("CryptoAsset")},
};

static int is_wanted(const struct development *d, int row) { return d->film && d->settings.aovs >> rows[row].aov & 1; }

status development_mattes_begin(struct development *d, struct error *err)
{
    const struct scene *scene = &d->description; /* empty if it could not be read: then things have numbers */

    for (int i = 0; i < DEVELOPMENT_MATTES; i++) {
        if (!is_wanted(d, i) || d->mattes[i].ids)
            continue;
        TRY(cryptomatte_init(&d->mattes[i], rows[i].kind,
                             rows[i].counts == AOV_CRYPTO_MATERIAL ? scene->material_count : scene->instance_count,
                             rows[i].thing_name, scene, err));
    }
    return STATUS_OK;
}

void development_mattes_end(struct development *d)
{
    for (int i = 0; i < DEVELOPMENT_MATTES; i++)
        cryptomatte_release(&d->mattes[i]);
}

size_t development_mattes_channels(const struct development *d, struct exr_channel *out)
{
    size_t count = 0;

    for (int i = 0; i < DEVELOPMENT_MATTES; i++)
        for (int c = 0; c < CRYPTOMATTE_CHANNELS && is_wanted(d, i); c++)
            out[count++] = (struct exr_channel){rows[i].channels[d->settings.exr_names][c], 1};
    return count;
}

size_t development_mattes_attributes(const struct development *d, struct exr_attribute *out,
                                     char names[DEVELOPMENT_MATTE_ATTRIBUTES][CRYPTOMATTE_NAME_SIZE])
{
    size_t count = 0;

    for (int i = 0; i < DEVELOPMENT_MATTES; i++) {
        const char *type = rows[i].types[d->settings.exr_names];
        const struct {
            const char *field, *text;
        } fields[] = {{"name", type},
                      {"hash", "MurmurHash3_32"},
                      {"conversion", "uint32_to_float32"},
                      {"manifest", buffer_text(&d->mattes[i].manifest)}};
        for (size_t f = 0; f < sizeof fields / sizeof *fields && is_wanted(d, i); f++, count++) {
            cryptomatte_attribute(names[count], type, fields[f].field);
            out[count] = (struct exr_attribute){.name = names[count], .text = fields[f].text};
        }
    }
    return count;
}

uint64_t development_mattes_lost(const struct development *d)
{
    uint64_t lost = 0;

    for (int i = 0; i < DEVELOPMENT_MATTES; i++)
        if (is_wanted(d, i) && rows[i].aov == rows[i].counts)
            lost += film_things_lost(d->film, rows[i].aov);
    return lost;
}

/* One tile's lines, of lines y .. y + height - 1. */
static void put_tile(const struct development *d, int row, uint32_t tile, uint32_t y, uint32_t height, float *planes)
{
    const uint32_t width = film_width(d->film);
    const struct tile_rect rect = tile_rect_of(width, film_height(d->film), tile);
    const size_t plane = (size_t)width * height;

    for (uint32_t p = 0; p < rect.width * rect.height; p++) {
        const uint32_t line = rect.y + p / rect.width;
        struct film_thing things[FILM_THINGS_MAX];
        float values[CRYPTOMATTE_CHANNELS];
        if (line < y || line >= y + height)
            continue;
        cryptomatte_rank(&d->mattes[row], things, film_things(d->film, tile, rows[row].counts, p, things), values);
        for (size_t c = 0; c < CRYPTOMATTE_CHANNELS; c++)
            planes[c * plane + (size_t)(line - y) * width + rect.x + p % rect.width] = values[c];
    }
}

float *development_mattes_lines(const struct development *d, uint32_t y, uint32_t height, float *planes)
{
    for (int i = 0; i < DEVELOPMENT_MATTES; i++) {
        if (!is_wanted(d, i))
            continue;
        for (uint32_t tile = y / TILE_SIZE * tiles_across(film_width(d->film)); tile < film_tile_count(d->film); tile++) {
            if (tile_rect_of(film_width(d->film), film_height(d->film), tile).y >= y + height)
                break;
            put_tile(d, i, tile, y, height, planes);
        }
        planes += (size_t)CRYPTOMATTE_CHANNELS * film_width(d->film) * height;
    }
    return planes;
}
