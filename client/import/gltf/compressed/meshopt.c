#include "client/import/gltf/compressed/meshopt.h"

#include <math.h>
#include <string.h>

#include "common/base/bytes.h"

enum {
    GROUP = 16,              /* elements whose deltas share a width */
    BLOCK_ELEMENTS_MAX = 256,
    BLOCK_BYTES = 8192,
    CHANNEL = 4,             /* bytes of an element that are coded alike */
    TAIL_BYTES_V0 = 32,
    TAIL_BYTES_V1 = 24,
    CODES_TAIL_BYTES = 16,
    INDICES_TAIL_BYTES = 4,
    FIFO = 16,
};

const char *const meshopt_mode_names[MESHOPT_MODES] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
const char *const meshopt_filter_names[MESHOPT_FILTERS] = {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"};

static const char cut_short[] = "its stream is cut short", left_over[] = "its stream has bytes left over";

struct stream {
    const uint8_t *at, *end;
};

static size_t left(const struct stream *s) { return (size_t)(s->end - s->at); }

static size_t block_elements(size_t stride)
{
    size_t most = BLOCK_BYTES / stride / GROUP * GROUP;

    return most < BLOCK_ELEMENTS_MAX ? most : BLOCK_ELEMENTS_MAX;
}

const char *meshopt_check(enum meshopt_mode mode, enum meshopt_filter filter, size_t count, size_t stride,
                          size_t size_bytes)
{
    if (count == 0)
        return "count must be at least 1";
    if (mode != MESHOPT_ATTRIBUTES) {
        if (stride != 2 && stride != 4)
            return "byteStride of indices must be 2 or 4";
        if (filter != MESHOPT_NONE)
            return "indices have no filter";
        if (mode == MESHOPT_TRIANGLES && count % 3 != 0)
            return "count must be a multiple of 3";
        return size_bytes < (mode == MESHOPT_TRIANGLES ? count / 3 : count) ? cut_short : NULL;
    }
    if (stride < CHANNEL || stride > MESHOPT_STRIDE_MAX || stride % CHANNEL != 0)
        return "byteStride must be 4 to 256, and a multiple of 4";
    if ((filter == MESHOPT_OCTAHEDRAL || filter == MESHOPT_COLOR) && stride != 4 && stride != 8)
        return "byteStride must be 4 or 8 for its filter";
    if (filter == MESHOPT_QUATERNION && stride != 8)
        return "byteStride must be 8 for its filter";
    /* The least that a block takes are the control bytes of version 1. */
    return (count - 1) / block_elements(stride) + 1 > size_bytes / (stride / CHANNEL) ? cut_short : NULL;
}

/* ---- attributes --------------------------------------------------------------------------- */

/* The deltas of one group in `bits` each; those of all ones follow as bytes. */
static const char *read_group(struct stream *s, int bits, uint8_t *out)
{
    const uint8_t *packed = s->at;
    uint8_t sentinel = (uint8_t)((1 << bits) - 1);

    if (left(s) < (size_t)bits * GROUP / 8)
        return cut_short;
    s->at += bits * GROUP / 8;
    if (bits == 8)
        memcpy(out, packed, GROUP);
    for (int i = 0; bits < 8 && i < GROUP; i++) {
        int in_byte = i * bits % 8;
        int shift = bits == 1 ? in_byte : 8 - bits - in_byte; /* single bits begin at the other end */
        out[i] = bits ? (uint8_t)(packed[i * bits / 8] >> shift) & sentinel : 0;
        if (bits && out[i] == sentinel) {
            if (left(s) == 0)
                return cut_short;
            out[i] = *s->at++;
        }
    }
    return NULL;
}

/* The deltas of one byte of `count` elements. control: the mode of version 1; -1: version 0. */
static const char *read_deltas(struct stream *s, int control, size_t count, uint8_t out[BLOCK_ELEMENTS_MAX])
{
    static const uint8_t widths[3][4] = {{0, 2, 4, 8}, {0, 1, 2, 4}, {1, 2, 4, 8}};
    size_t groups = (count + GROUP - 1) / GROUP, header_bytes = (groups + 3) / 4;
    const uint8_t *header = s->at;

    if (control == 2) {
        memset(out, 0, count);
        return NULL;
    }
    if (left(s) < (control == 3 ? count : header_bytes))
        return cut_short;
    if (control == 3) {
        memcpy(out, s->at, count);
        s->at += count;
        return NULL;
    }
    s->at += header_bytes;
    for (size_t g = 0; g < groups; g++) {
        const char *wrong = read_group(s, widths[control + 1][header[g / 4] >> g % 4 * 2 & 3], out + g * GROUP);
        if (wrong)
            return wrong;
    }
    return NULL;
}

static uint32_t unzigzag(uint32_t v) { return v & 1 ? ~(v >> 1) : v >> 1; }

/* Add the deltas of one channel up into bytes `out`, `out + stride` and so on, from `last` on, which gets the last ones. */
static void add_deltas(uint8_t mode, uint8_t deltas[CHANNEL][BLOCK_ELEMENTS_MAX], size_t count, size_t stride,
                       uint8_t last[CHANNEL], uint8_t *out)
{
    for (size_t i = 0; i < count; i++, out += stride) {
        if (mode == 0)
            for (int b = 0; b < CHANNEL; b++)
                last[b] = (uint8_t)(last[b] + unzigzag(deltas[b][i]));
        if (mode == 1)
            for (int b = 0; b < CHANNEL; b += 2) {
                uint32_t delta = unzigzag((uint32_t)deltas[b][i] | (uint32_t)deltas[b + 1][i] << 8);
                uint32_t value = ((uint32_t)last[b] | (uint32_t)last[b + 1] << 8) + delta;
                last[b] = (uint8_t)value;
                last[b + 1] = (uint8_t)(value >> 8);
            }
        if ((mode & 15) == 2) {
            uint32_t delta = (uint32_t)deltas[0][i] | (uint32_t)deltas[1][i] << 8 | (uint32_t)deltas[2][i] << 16 |
                             (uint32_t)deltas[3][i] << 24;
            uint32_t turn = mode >> 4;
            delta = delta >> turn | delta << (-turn & 31); /* the encoder turned it to the left */
            for (int b = 0; b < CHANNEL; b++)
                last[b] ^= (uint8_t)(delta >> 8 * b);
        }
        memcpy(out, last, CHANNEL);
    }
}

static const char *decode_attributes(struct stream s, size_t count, size_t stride, uint8_t *out)
{
    uint8_t deltas[CHANNEL][BLOCK_ELEMENTS_MAX], last[MESHOPT_STRIDE_MAX];
    const uint8_t *modes = NULL;
    size_t channels = stride / CHANNEL, tail, most = block_elements(stride);
    int version;

    if (left(&s) < 1)
        return cut_short;
    version = *s.at - 0xa0;
    if (version != 0 && version != 1)
        return "its stream is of attributes of no version that is read (0 and 1 are)";
    s.at++;
    tail = version ? stride + channels : stride;
    if (left(&s) < tail || left(&s) < (version ? TAIL_BYTES_V1 : TAIL_BYTES_V0))
        return cut_short;
    memcpy(last, s.end - tail, stride);
    if (version)
        modes = s.end - channels;
    for (size_t c = 0; version && c < channels; c++)
        if (modes[c] > 1 && (modes[c] & 15) != 2)
            return "its stream has a channel of an unknown mode";
    s.end -= tail > (version ? TAIL_BYTES_V1 : TAIL_BYTES_V0) ? tail : version ? TAIL_BYTES_V1 : TAIL_BYTES_V0;
    for (size_t first = 0; first < count; first += most) {
        size_t n = count - first < most ? count - first : most;
        const uint8_t *control = s.at;
        if (version && left(&s) < channels)
            return cut_short;
        s.at += version ? channels : 0;
        for (size_t c = 0; c < channels; c++) {
            for (int b = 0; b < CHANNEL; b++) {
                const char *wrong = read_deltas(&s, version ? control[c] >> 2 * b & 3 : -1, n, deltas[b]);
                if (wrong)
                    return wrong;
            }
            add_deltas(modes ? modes[c] : 0, deltas, n, stride, last + c * CHANNEL, out + first * stride + c * CHANNEL);
        }
    }
    return s.at == s.end ? NULL : left_over;
}

/* ---- indices ------------------------------------------------------------------------------ */

static const char *read_number(struct stream *s, uint32_t *out)
{
    *out = 0;
    for (int i = 0; i < 5; i++) {
        if (left(s) == 0)
            return cut_short;
        *out |= (uint32_t)(*s->at & 127) << 7 * i;
        if (!(*s->at++ & 128))
            return NULL;
    }
    return "its stream has a number of more than five bytes";
}

static void put_index(uint8_t *out, size_t stride, size_t at, uint32_t value)
{
    out[at * stride] = (uint8_t)value;
    out[at * stride + 1] = (uint8_t)(value >> 8);
    if (stride == 4) {
        out[at * stride + 2] = (uint8_t)(value >> 16);
        out[at * stride + 3] = (uint8_t)(value >> 24);
    }
}

static const char *decode_indices(struct stream s, size_t count, size_t stride, uint8_t *out)
{
    uint32_t last[2] = {0, 0};

    if (left(&s) < 1 + INDICES_TAIL_BYTES)
        return cut_short;
    if (*s.at++ != 0xd1)
        return "its stream is none of indices of version 1";
    s.end -= INDICES_TAIL_BYTES;
    for (size_t i = 0; i < count; i++) {
        uint32_t v;
        const char *wrong = read_number(&s, &v);
        if (wrong)
            return wrong;
        last[v & 1] += unzigzag(v >> 1);
        put_index(out, stride, i, last[v & 1]);
    }
    return s.at == s.end ? NULL : left_over;
}

/* ---- triangles ---------------------------------------------------------------------------- */

struct triangles {
    struct stream codes, data;
    const uint8_t *auxiliary; /* [CODES_TAIL_BYTES] */
    uint32_t next, last;
    uint32_t edges[FIFO][2], vertices[FIFO];
    unsigned edge_count, vertex_count; /* that were ever pushed */
    const char *wrong;
};

static void push_edge(struct triangles *t, uint32_t a, uint32_t b)
{
    t->edges[t->edge_count % FIFO][0] = a;
    t->edges[t->edge_count++ % FIFO][1] = b;
}

static void push_vertex(struct triangles *t, uint32_t v) { t->vertices[t->vertex_count++ % FIFO] = v; }

static const char not_there[] = "its stream names a vertex before there is one";

/* 0: the latest one. */
static uint32_t recent_vertex(struct triangles *t, unsigned back)
{
    if (back >= t->vertex_count) {
        t->wrong = not_there;
        return 0;
    }
    return t->vertices[(t->vertex_count - 1 - back) % FIFO];
}

static uint32_t explicit_vertex(struct triangles *t)
{
    uint32_t v = 0;
    const char *wrong = read_number(&t->data, &v);

    if (wrong)
        t->wrong = wrong;
    return t->last += unzigzag(v);
}

/* By four bits: 0: the next one; 15: explicit; else one of the latest. */
static uint32_t coded_vertex(struct triangles *t, unsigned code)
{
    return code == 0 ? t->next++ : code == 15 ? explicit_vertex(t) : recent_vertex(t, code - 1);
}

/* A triangle at a recent edge. */
static void beside_edge(struct triangles *t, unsigned code, uint32_t corner[3])
{
    unsigned edge = code >> 4, vertex = code & 15;
    int is_new = vertex == 0 || vertex >= 13;

    if (edge >= t->edge_count) {
        t->wrong = not_there;
        return;
    }
    memcpy(corner, t->edges[(t->edge_count - 1 - edge) % FIFO], 2 * sizeof *corner);
    if (vertex == 13 || vertex == 14)
        corner[2] = t->last += vertex == 13 ? UINT32_MAX : 1;
    else
        corner[2] = vertex == 0 || vertex == 15 ? coded_vertex(t, vertex) : recent_vertex(t, vertex);
    push_edge(t, corner[2], corner[1]);
    push_edge(t, corner[0], corner[2]);
    if (is_new)
        push_vertex(t, corner[2]);
}

/* A triangle at no recent edge. */
static void alone(struct triangles *t, unsigned code, uint32_t corner[3])
{
    unsigned two = 0, which = code & 15;

    if (which < 14) {
        two = t->auxiliary[which];
    } else if (left(&t->data) == 0) {
        t->wrong = cut_short;
        return;
    } else {
        two = *t->data.at++;
        if (two == 0)
            t->next = 0;
    }
    corner[0] = coded_vertex(t, which == 15 ? 15 : 0);
    corner[1] = coded_vertex(t, two >> 4);
    corner[2] = coded_vertex(t, two & 15);
    push_edge(t, corner[1], corner[0]);
    push_edge(t, corner[2], corner[1]);
    push_edge(t, corner[0], corner[2]);
    push_vertex(t, corner[0]);
    if (two >> 4 == 0 || two >> 4 == 15)
        push_vertex(t, corner[1]);
    if ((two & 15) == 0 || (two & 15) == 15)
        push_vertex(t, corner[2]);
}

static const char *decode_triangles(struct stream s, size_t count, size_t stride, uint8_t *out)
{
    struct triangles t = {.next = 0};

    if (left(&s) < 1 + count / 3 + CODES_TAIL_BYTES)
        return cut_short;
    if (*s.at++ != 0xe1)
        return "its stream is none of triangles of version 1";
    t.auxiliary = s.end - CODES_TAIL_BYTES;
    t.codes = (struct stream){s.at, s.at + count / 3};
    t.data = (struct stream){t.codes.end, t.auxiliary};
    for (int i = 0; i < CODES_TAIL_BYTES; i++)
        if ((i >= 14 && t.auxiliary[i]) || t.auxiliary[i] >> 4 == 15 || (t.auxiliary[i] & 15) == 15)
            return "its stream has a wrong table of codes";
    for (size_t i = 0; i < count; i += 3) {
        unsigned code = *t.codes.at++;
        uint32_t corner[3] = {0, 0, 0};
        if (code >> 4 < 15)
            beside_edge(&t, code, corner);
        else
            alone(&t, code, corner);
        if (t.wrong)
            return t.wrong;
        for (size_t c = 0; c < 3; c++)
            put_index(out, stride, i + c, corner[c]);
    }
    return t.data.at == t.data.end ? NULL : left_over;
}

/* ---- filters ------------------------------------------------------------------------------ */

/* Four numbers of `bytes` each, signed or not. */
static void get_four(const uint8_t *at, size_t bytes, int is_signed, int32_t v[4])
{
    for (size_t i = 0; i < 4; i++) {
        uint32_t raw = bytes == 1 ? at[i] : (uint32_t)at[2 * i] | (uint32_t)at[2 * i + 1] << 8;
        int32_t half = bytes == 1 ? 128 : 32768;
        v[i] = (int32_t)raw - (is_signed && (int32_t)raw >= half ? 2 * half : 0);
    }
}

static void put_four(uint8_t *at, size_t bytes, const int32_t v[4])
{
    for (size_t i = 0; i < 4; i++) {
        at[bytes * i] = (uint8_t)v[i];
        if (bytes == 2)
            at[2 * i + 1] = (uint8_t)((uint32_t)v[i] >> 8);
    }
}

/* To the nearest integer, at most `most` either way; 0 for what is no number. */
static int32_t rounded(float v, float most) { return v != v ? 0 : (int32_t)roundf(fminf(fmaxf(v, -most), most)); }

static void filter_octahedral(uint8_t *at, size_t bytes)
{
    float most = bytes == 1 ? 127.0f : 32767.0f, x, y, z, t, length;
    int32_t v[4];

    get_four(at, bytes, 1, v);
    x = (float)v[0] / (float)v[2];
    y = (float)v[1] / (float)v[2];
    z = 1.0f - fabsf(x) - fabsf(y);
    t = fminf(z, 0.0f);
    x += x >= 0 ? t : -t;
    y += y >= 0 ? t : -t;
    length = sqrtf(x * x + y * y + z * z);
    v[0] = rounded(x / length * most, most);
    v[1] = rounded(y / length * most, most);
    v[2] = rounded(z / length * most, most);
    put_four(at, bytes, v);
}

static void filter_quaternion(uint8_t *at)
{
    float part[3], squares = 0;
    int32_t v[4], out[4];

    get_four(at, 2, 1, v);
    for (int i = 0; i < 3; i++) {
        part[i] = (float)v[i] / (float)(v[3] | 3) * 0.70710678f;
        squares += part[i] * part[i];
        out[(v[3] + 1 + i) & 3] = rounded(part[i] * 32767.0f, 32767.0f);
    }
    out[v[3] & 3] = rounded(sqrtf(fmaxf(0.0f, 1.0f - squares)) * 32767.0f, 32767.0f);
    put_four(at, 2, out);
}

static void filter_exponential(uint8_t *at)
{
    uint32_t raw = bytes_get32(at);
    int32_t exponent = (int32_t)(raw >> 24) - (raw >> 31 ? 256 : 0);
    int32_t mantissa = (int32_t)(raw & 0xffffff) - (raw & 0x800000 ? 0x1000000 : 0);
    float value = ldexpf((float)mantissa, exponent);

    memcpy(at, &value, sizeof value);
}

static void filter_color(uint8_t *at, size_t bytes)
{
    float most = bytes == 1 ? 255.0f : 65535.0f, scale;
    int32_t v[4], u[4], one = 1, alpha;

    get_four(at, bytes, 1, v);
    get_four(at, bytes, 0, u);
    while (one < u[3])
        one = one * 2 + 1;
    alpha = u[3] & one >> 1;
    scale = most / (float)one;
    u[1] = rounded(fmaxf((float)(u[0] + v[2]) * scale, 0.0f), most);
    u[2] = rounded(fmaxf((float)(u[0] - v[1] - v[2]) * scale, 0.0f), most);
    u[0] = rounded(fmaxf((float)(u[0] + v[1] - v[2]) * scale, 0.0f), most);
    u[3] = rounded((float)(alpha << 1 | (alpha & 1)) * scale, most);
    put_four(at, bytes, u);
}

static void filter_all(enum meshopt_filter filter, size_t count, size_t stride, uint8_t *out)
{
    size_t step = filter == MESHOPT_EXPONENTIAL ? 4 : stride;

    for (uint8_t *at = out; filter != MESHOPT_NONE && at < out + count * stride; at += step)
        switch (filter) {
        case MESHOPT_OCTAHEDRAL: filter_octahedral(at, stride / 4); break;
        case MESHOPT_QUATERNION: filter_quaternion(at); break;
        case MESHOPT_EXPONENTIAL: filter_exponential(at); break;
        default: filter_color(at, stride / 4); break;
        }
}

const char *meshopt_decode(enum meshopt_mode mode, enum meshopt_filter filter, size_t count, size_t stride,
                           const uint8_t *stream, size_t size_bytes, uint8_t *out)
{
    const struct stream s = {stream, stream + size_bytes};
    const char *wrong = mode == MESHOPT_ATTRIBUTES  ? decode_attributes(s, count, stride, out)
                        : mode == MESHOPT_TRIANGLES ? decode_triangles(s, count, stride, out)
                                                    : decode_indices(s, count, stride, out);

    if (!wrong)
        filter_all(filter, count, stride, out);
    return wrong;
}
