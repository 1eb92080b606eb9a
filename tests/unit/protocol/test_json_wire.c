/* Messages as JSON and back: every message of azulejo.proto, filled at random, is the same bytes again. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <jansson.h>

#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/scene/effects.h"
#include "common/schema/choices.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/json/json_wire.h"

enum { ROUNDS = 200, MESSAGES_MAX = 256, DEPTH = 3 };

/* ---- random messages ---------------------------------------------------------------------------- */

static uint64_t state_of_random;

static uint64_t random_u64(void) /* splitmix64 */
{
    uint64_t z = state_of_random += 0x9e3779b97f4a7c15u;

    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

static uint64_t below(uint64_t n) { return random_u64() % n; }

/* Mostly near the ends of what there is. */
static uint64_t random_bits(void)
{
    static const uint64_t ends[] = {0, 1, UINT32_MAX, INT32_MAX, (uint64_t)1 << 53, ((uint64_t)1 << 53) + 1,
                                    INT64_MAX, (uint64_t)1 << 63, UINT64_MAX};

    return below(2) ? ends[below(sizeof ends / sizeof *ends)] : random_u64() >> below(64);
}

static double random_real(void)
{
    static const double some[] = {0, -0.0, 1, 0.1, 1e300, -1e-300, DBL_MIN / 8, DBL_MAX, 12345678901234567.0};

    switch (below(6)) {
    case 0: return NAN;
    case 1: return INFINITY;
    case 2: return -INFINITY;
    case 3: return some[below(sizeof some / sizeof *some)];
    default: return ldexp((double)(int64_t)random_u64(), (int)below(80) - 90);
    }
}

static float random_float(void)
{
    static const float some[] = {0.1f, -0.0f, FLT_MIN / 8, FLT_MAX, 16777217.0f, 1.0f / 3};
    double d = random_real();

    if (below(2))
        return some[below(sizeof some / sizeof *some)];
    return isfinite(d) && fabs(d) > (double)FLT_MAX ? 1.5f : (float)d;
}

static char *random_text(size_t number)
{
    static const char *const pieces[] = {"", "a", "\"", "\\", "\n", "\x01", "\x7f", "</script>", "\xc3\xa9",
                                         "\xe2\x80\xae", "\xf0\x9f\x98\x80", "{}", ",", "null"};
    char text[256];

    snprintf(text, sizeof text, "%zu", number);
    for (uint64_t i = below(8); i > 0; i--)
        strcat(text, pieces[below(sizeof pieces / sizeof *pieces)]);
    return mem_strdup(text);
}

static ProtobufCMessage *random_message(const ProtobufCMessageDescriptor *d, int depth);

static void fill_value(const ProtobufCFieldDescriptor *f, char *at, size_t number, int depth)
{
    const ProtobufCEnumDescriptor *e = f->descriptor;
    ProtobufCBinaryData bytes;

    switch (f->type) {
    case PROTOBUF_C_TYPE_BOOL: *(protobuf_c_boolean *)at = (protobuf_c_boolean)below(2); break;
    case PROTOBUF_C_TYPE_ENUM: *(int *)at = e->values[below(e->n_values)].value; break;
    case PROTOBUF_C_TYPE_FLOAT: *(float *)at = random_float(); break;
    case PROTOBUF_C_TYPE_DOUBLE: *(double *)at = random_real(); break;
    case PROTOBUF_C_TYPE_STRING: *(char **)at = random_text(number); break;
    case PROTOBUF_C_TYPE_BYTES:
        bytes.len = below(40);
        bytes.data = bytes.len ? mem_alloc(bytes.len) : NULL;
        for (size_t i = 0; i < bytes.len; i++)
            bytes.data[i] = (uint8_t)random_u64();
        *(ProtobufCBinaryData *)(void *)at = bytes;
        break;
    case PROTOBUF_C_TYPE_MESSAGE: *(ProtobufCMessage **)(void *)at = random_message(f->descriptor, depth + 1); break;
    case PROTOBUF_C_TYPE_UINT64:
    case PROTOBUF_C_TYPE_INT64:
    case PROTOBUF_C_TYPE_SINT64:
    case PROTOBUF_C_TYPE_FIXED64:
    case PROTOBUF_C_TYPE_SFIXED64: *(uint64_t *)(void *)at = random_bits(); break;
    default: *(uint32_t *)(void *)at = (uint32_t)random_bits(); break;
    }
}

static size_t bytes_of(const ProtobufCFieldDescriptor *f)
{
    switch (f->type) {
    case PROTOBUF_C_TYPE_BOOL: return sizeof(protobuf_c_boolean);
    case PROTOBUF_C_TYPE_BYTES: return sizeof(ProtobufCBinaryData);
    case PROTOBUF_C_TYPE_STRING: case PROTOBUF_C_TYPE_MESSAGE: return sizeof(void *);
    case PROTOBUF_C_TYPE_UINT64: case PROTOBUF_C_TYPE_INT64: case PROTOBUF_C_TYPE_SINT64:
    case PROTOBUF_C_TYPE_FIXED64: case PROTOBUF_C_TYPE_SFIXED64: case PROTOBUF_C_TYPE_DOUBLE: return 8;
    default: return 4;
    }
}

static ProtobufCMessage *random_message(const ProtobufCMessageDescriptor *d, int depth)
{
    ProtobufCMessage *m = mem_alloc(d->sizeof_message);

    d->message_init(m);
    for (unsigned i = 0; i < d->n_fields; i++) {
        const ProtobufCFieldDescriptor *f = &d->fields[i];
        char *at = (char *)m + f->offset;
        uint32_t *quantifier = (uint32_t *)(void *)((char *)m + f->quantifier_offset);

        if (f->type == PROTOBUF_C_TYPE_MESSAGE && depth >= DEPTH)
            continue;
        if (f->flags & PROTOBUF_C_FIELD_FLAG_ONEOF) {
            if (*quantifier || below(20))
                continue;
            *quantifier = f->id;
        } else if (f->label == PROTOBUF_C_LABEL_REPEATED) {
            size_t count = below(4), each = bytes_of(f);
            char *values = count ? mem_calloc(count, each) : NULL;
            for (size_t k = 0; k < count; k++)
                fill_value(f, values + k * each, k, depth);
            /* A map's keys differ: random_text begins with its number. */
            for (size_t k = 0; k < count && f->type == PROTOBUF_C_TYPE_MESSAGE; k++) {
                ProtobufCMessage *entry = ((ProtobufCMessage **)(void *)values)[k];
                const ProtobufCFieldDescriptor *key = &entry->descriptor->fields[0];
                if (strcmp(key->name, "key") == 0) {
                    char *old = *(char **)((char *)entry + key->offset);
                    if (old != key->default_value)
                        mem_free(old);
                    *(char **)((char *)entry + key->offset) = random_text(k);
                }
            }
            *(void **)at = values;
            *(size_t *)((char *)m + f->quantifier_offset) = count;
            continue;
        } else if (below(8) == 0) {
            continue; /* as it was made: 0, or absent */
        }
        fill_value(f, at, 0, depth);
    }
    return m;
}

/* ---- every message ------------------------------------------------------------------------------- */

static const ProtobufCMessageDescriptor *found[MESSAGES_MAX];
static size_t found_count;

static void find_messages(const ProtobufCMessageDescriptor *d)
{
    for (size_t i = 0; i < found_count; i++)
        if (found[i] == d)
            return;
    assert_true(found_count < MESSAGES_MAX);
    found[found_count++] = d;
    for (unsigned i = 0; i < d->n_fields; i++)
        if (d->fields[i].type == PROTOBUF_C_TYPE_MESSAGE)
            find_messages(d->fields[i].descriptor);
}

static int is_found(const char *name, size_t length)
{
    for (size_t i = 0; i < found_count; i++)
        if (strlen(found[i]->short_name) == length && strncmp(found[i]->short_name, name, length) == 0)
            return 1;
    return 0;
}

/* The envelope reaches every message that the schema declares. */
static void test_all_messages_are_found(void **state)
{
    struct buffer proto = BUFFER_INIT;
    int declared = 0;

    (void)state;
    assert_int_equal(file_read("protocol/azulejo.proto", 1 << 20, &proto, NULL), STATUS_OK);
    for (const char *at = buffer_text(&proto); (at = strstr(at, "\nmessage ")); declared++) {
        at += strlen("\nmessage ");
        if (!is_found(at, strcspn(at, " ")))
            fail_msg("%.30s is not tested", at);
    }
    assert_true(declared > 70);
    buffer_release(&proto);
}

static uint8_t *pack(const ProtobufCMessage *m, size_t *size)
{
    uint8_t *bytes;

    *size = protobuf_c_message_get_packed_size(m);
    bytes = mem_alloc(*size + 1);
    assert_int_equal(protobuf_c_message_pack(m, bytes), *size);
    return bytes;
}

static void check_round_trip(const ProtobufCMessage *m)
{
    struct buffer text = BUFFER_INIT;
    struct error err = {0};
    ProtobufCMessage *again;
    size_t size, size_again;
    uint8_t *bytes, *bytes_again;

    json_wire_put(&text, m);
    assert_true(buffer_ok(&text));
    if (json_wire_get(&again, m->descriptor, buffer_text(&text), text.size, &err) != STATUS_OK)
        fail_msg("%s: %s: %s", m->descriptor->short_name, err.text, buffer_text(&text));
    bytes = pack(m, &size);
    bytes_again = pack(again, &size_again);
    if (size != size_again || memcmp(bytes, bytes_again, size) != 0)
        fail_msg("%s changed: %s", m->descriptor->short_name, buffer_text(&text));
    mem_free(bytes);
    mem_free(bytes_again);
    json_wire_free(again);
    buffer_release(&text);
}

static void test_round_trips(void **state)
{
    (void)state;
    for (size_t i = 0; i < found_count; i++)
        for (int round = 0; round < ROUNDS; round++) {
            ProtobufCMessage *m;
            state_of_random = i * 1000003 + (size_t)round;
            m = random_message(found[i], 0);
            check_round_trip(m);
            json_wire_free(m);
        }
}

/* Cut anywhere, a text is refused, and nothing leaks (the sanitizers look). */
static void test_cut_texts(void **state)
{
    (void)state;
    for (size_t i = 0; i < found_count; i++) {
        struct buffer text = BUFFER_INIT;
        ProtobufCMessage *m, *again;
        state_of_random = i;
        m = random_message(found[i], 0);
        json_wire_put(&text, m);
        for (size_t cut = 1; cut < text.size; cut += 1 + text.size / 50)
            assert_int_equal(json_wire_get(&again, found[i], buffer_text(&text), cut, NULL), STATUS_ERR_INPUT);
        buffer_release(&text);
        json_wire_free(m);
    }
}

static void test_no_memory(void **state)
{
    (void)state;
    for (size_t i = 0; i < found_count; i++) {
        struct buffer text = BUFFER_INIT;
        ProtobufCMessage *m, *again = NULL;
        struct error err;
        status s = STATUS_ERR_NO_MEMORY;
        state_of_random = i;
        m = random_message(found[i], 1);
        json_wire_put(&text, m);
        for (long fails = 0; s != STATUS_OK && fails < 1000; fails++) {
            mem_fault_arm(fails, 1);
            s = json_wire_get(&again, found[i], buffer_text(&text), text.size, &err);
            mem_fault_arm(-1, 0);
            if (s != STATUS_OK)
                assert_int_equal(s, STATUS_ERR_NO_MEMORY);
        }
        json_wire_free(again);
        json_wire_free(m);
        buffer_release(&text);
    }
}

/* ---- how it looks ---------------------------------------------------------------------------------- */

static void test_form(void **state)
{
    Azulejo__Wire__JobInfo info = AZULEJO__WIRE__JOB_INFO__INIT;
    Azulejo__Wire__JobPriority priority = AZULEJO__WIRE__JOB_PRIORITY__INIT;
    Azulejo__Wire__OutputSettings output = AZULEJO__WIRE__OUTPUT_SETTINGS__INIT;
    Azulejo__Wire__OutputSettings__ParametersEntry key = AZULEJO__WIRE__OUTPUT_SETTINGS__PARAMETERS_ENTRY__INIT;
    Azulejo__Wire__OutputSettings__ParametersEntry *keys[] = {&key};
    struct buffer text = BUFFER_INIT;
    uint8_t digest[] = {0, 0xab};

    (void)state;
    priority.job = ((uint64_t)1 << 53) + 1;
    priority.priority = -3;
    json_wire_put(&text, &priority.base);
    assert_string_equal(buffer_text(&text), "{\"job\":\"9007199254740993\",\"priority\":-3}");
    buffer_clear(&text);
    info.state = AZULEJO__WIRE__JOB_STATE__JOB_FINISHING;
    info.name = (char *)"a\xff<b>\n";
    info.seconds_left = -1.5;
    info.worst = NAN;
    info.scene = (ProtobufCBinaryData){2, digest};
    key.key = (char *)"key";
    key.value = 0.18;
    output.n_parameters = 1;
    output.parameters = keys;
    info.output = &output;
    json_wire_put(&text, &info.base);
    assert_non_null(strstr(buffer_text(&text), "\"state\":\"finishing\""));
    assert_non_null(strstr(buffer_text(&text), "\"name\":\"a\\ufffd<b>\\u000a\""));
    assert_non_null(strstr(buffer_text(&text), "\"seconds_left\":-1.5"));
    assert_non_null(strstr(buffer_text(&text), "\"worst\":null"));
    assert_non_null(strstr(buffer_text(&text), "\"scene\":\"00ab\""));
    assert_non_null(strstr(buffer_text(&text), "\"parameters\":{\"key\":0.18}"));
    assert_non_null(strstr(buffer_text(&text), "\"forecasts\":[]"));
    assert_null(strstr(buffer_text(&text), "\"settings\""));
    buffer_release(&text);
}

/* A submission in words, and the same in numbers. */
static void test_words(void **state)
{
    static const char words[] =
        "{\"settings\":{\"env_sampling\":\"uniform-only\",\"isa\":\"avx512\",\"sampler\":\"independent\","
        "\"bvh_quality\":\"high\",\"without\":[\"caustics\",\"normal map\",\"fog\"],\"aovs\":[\"object-id\"]},"
        "\"output\":{\"parameters\":{\"scale\":\"local\",\"key\":2},\"tonemap\":\"reinhard02\"},"
        "\"stop\":{\"measure\":\"psnr\"}}";
    static const char numbers[] =
        "{\"settings\":{\"env_sampling\":4,\"isa\":\"2\",\"sampler\":1,\"bvh_quality\":2,"
        "\"without\":\"554050781440\",\"aovs\":[5]},"
        "\"output\":{\"parameters\":{\"scale\":1,\"key\":2},\"tonemap\":\"reinhard02\"},\"stop\":{\"measure\":2}}";
    struct buffer text[2] = {BUFFER_INIT, BUFFER_INIT};

    (void)state;
    for (int i = 0; i < 2; i++) {
        const Azulejo__Wire__JobSubmit *submit;
        const char *from = i ? numbers : words;
        struct error err = {0};
        ProtobufCMessage *m;
        if (json_wire_get(&m, &azulejo__wire__job_submit__descriptor, from, strlen(from), &err) != STATUS_OK)
            fail_msg("%s", err.text);
        submit = (const Azulejo__Wire__JobSubmit *)m;
        assert_int_equal(submit->settings->env_sampling, ENV_SAMPLING_UNIFORM_ONLY);
        assert_int_equal(submit->settings->without, EFFECT_CAUSTICS | EFFECT_NORMAL_MAP | EFFECT_FOG);
        assert_int_equal(submit->stop->measure, STOP_MEASURE_PSNR);
        json_wire_put(&text[i], m);
        json_wire_free(m);
    }
    assert_string_equal(buffer_text(&text[0]), buffer_text(&text[1]));
    assert_non_null(strstr(buffer_text(&text[0]), "\"env_sampling\":\"uniform-only\",\"isa\":\"avx512\""));
    assert_non_null(strstr(buffer_text(&text[0]), "\"without\":[\"normal-map\",\"fog\",\"caustics\"]"));
    assert_non_null(strstr(buffer_text(&text[0]), "\"parameters\":{\"scale\":\"local\",\"key\":2}"));
    assert_non_null(strstr(buffer_text(&text[0]), "\"measure\":\"psnr\""));
    buffer_release(&text[0]);
    buffer_release(&text[1]);
}

/* Each row of CHOICE_FIELDS names a number of a message, of as many bits as the set may have. */
static void test_choice_fields(void **state)
{
    const ProtobufCFieldDescriptor *f;

    (void)state;
#define FIELD(message, field, choice)                                                                                  \
    f = protobuf_c_message_descriptor_get_field_by_name(&azulejo__wire__##message##__descriptor, #field);              \
    assert_non_null(f);                                                                                                \
    assert_true(f->label != PROTOBUF_C_LABEL_REPEATED);                                                                \
    assert_true(f->type == PROTOBUF_C_TYPE_UINT32 || f->type == PROTOBUF_C_TYPE_UINT64);
#define SET(message, field, choice)                                                                                    \
    FIELD(message, field, choice)                                                                                      \
    assert_null(choice_word(CHOICE_##choice, f->type == PROTOBUF_C_TYPE_UINT32 ? 32 : 64));
    CHOICE_FIELDS(FIELD, SET)
#undef FIELD
#undef SET
}

static void check_refused(const ProtobufCMessageDescriptor *d, const char *text, status code, const char *says)
{
    struct error err = {0};
    ProtobufCMessage *m;
    status s = json_wire_get(&m, d, text, strlen(text), &err);

    if (s != code || !strstr(err.text, says))
        fail_msg("%s: %d '%s' instead of %d '%s'", text, s, err.text, code, says);
    assert_null(m);
}

static void test_refusals(void **state)
{
    const ProtobufCMessageDescriptor *submit = &azulejo__wire__job_submit__descriptor;
    const ProtobufCMessageDescriptor *query = &azulejo__wire__job_query__descriptor;
    struct buffer deep = BUFFER_INIT;

    (void)state;
    check_refused(query, "[]", STATUS_ERR_INPUT, "must be an object, not an array");
    check_refused(query, "{\"job\": 1", STATUS_ERR_INPUT, "the JSON in line 1, column 9: ");
    check_refused(query, "{\"job\": 1, \"job\": 2}", STATUS_ERR_INPUT, "duplicate");
    check_refused(query, "{\"jop\": 1}", STATUS_ERR_INPUT,
                  "there is no field 'jop'; the fields are: job, filter, before, first");
    check_refused(query, "{\"job\": -1}", STATUS_ERR_INPUT, "job: must be a whole number from 0 to 18446744073709551615, not -1");
    check_refused(query, "{\"job\": 1.5}", STATUS_ERR_INPUT, "job: must be a whole number");
    check_refused(query, "{\"job\": \"18446744073709551616\"}", STATUS_ERR_INPUT, "not '18446744073709551616'");
    check_refused(query, "{\"first\": 4294967296}", STATUS_ERR_INPUT, "first: must be a whole number from 0 to 4294967295");
    check_refused(query, "{\"filter\": \"some\"}", STATUS_ERR_INPUT,
                  "filter: 'some' is not known; it may be all, active, ended");
    check_refused(query, "{\"filter\": 1}", STATUS_ERR_INPUT, "filter: must be one of all, active, ended, not a whole number");
    check_refused(submit, "{\"scene\": \"AB\"}", STATUS_ERR_INPUT, "scene: must be bytes");
    check_refused(submit, "{\"scene\": \"abc\"}", STATUS_ERR_INPUT, "scene: must be bytes");
    check_refused(submit, "{\"force\": 1}", STATUS_ERR_INPUT, "force: must be true or false");
    check_refused(submit, "{\"name\": null}", STATUS_ERR_INPUT, "name: must be a text, not null");
    check_refused(submit, "{\"name\": \"a\\u0000b\"}", STATUS_ERR_INPUT, "the JSON in line 1");
    check_refused(submit, "{\"frames\": [1, \"x\"]}", STATUS_ERR_INPUT, "frames[1]: must be a whole number");
    check_refused(submit, "{\"settings\": {\"width\": {}}}", STATUS_ERR_INPUT, "settings.width: must be a whole number");
    check_refused(submit, "{\"settings\": {\"fps\": 1e39}}", STATUS_ERR_INPUT, "settings.fps: 1e+39 is too large");
    check_refused(submit, "{\"output\": {\"parameters\": {\"key\": []}}}", STATUS_ERR_INPUT,
                  "output.parameters.key: must be a number");
    check_refused(submit, "{\"settings\": {\"sampler\": \"halton\"}}", STATUS_ERR_INPUT,
                  "settings.sampler: 'halton' is not known; it may be sobol, independent");
    check_refused(submit, "{\"settings\": {\"sampler\": {}}}", STATUS_ERR_INPUT, "settings.sampler: must be");
    check_refused(submit, "{\"settings\": {\"without\": [\"fog\", \"smog\"]}}", STATUS_ERR_INPUT,
                  "settings.without[1]: 'smog' is not known; it may be diffuse, ");
    check_refused(submit, "{\"settings\": {\"without\": [64]}}", STATUS_ERR_INPUT, "settings.without[0]: must be");
    check_refused(submit, "{\"settings\": {\"without\": {}}}", STATUS_ERR_INPUT,
                  "settings.without: must be an array of words, not an object");
    check_refused(submit, "{\"output\": {\"tonemap\": \"reinhard02\", \"parameters\": {\"scale\": \"auto\"}}}",
                  STATUS_ERR_INPUT, "output.parameters.scale: 'auto' is not known; it may be ");
    check_refused(submit, "{\"output\": {\"parameters\": {\"scale\": \"local\"}}}", STATUS_ERR_INPUT,
                  "output.parameters.scale: must be a number");
    buffer_puts(&deep, "{\"frames\": [0");
    for (int i = 0; i < JSON_WIRE_ITEMS_MAX; i++)
        buffer_puts(&deep, ",0");
    buffer_puts(&deep, "]}");
    check_refused(submit, buffer_text(&deep), STATUS_ERR_LIMIT, "more than 65536 values");
    buffer_clear(&deep);
    for (int i = 0; i < 100000; i++)
        buffer_puts(&deep, "[");
    check_refused(submit, buffer_text(&deep), STATUS_ERR_INPUT, "maximum parsing depth");
    buffer_release(&deep);
}

static void check_set(ProtobufCMessage *m, const char *field, const char *text, status code)
{
    struct error err = {0};
    status s = json_wire_set(m, field, text, &err);

    if (s != code)
        fail_msg("%s=%s: %d %s", field, text, s, err.text);
}

/* What stands in paths and queries. */
static void test_set(void **state)
{
    ProtobufCMessage *m;
    Azulejo__Wire__JobQuery *query;
    Azulejo__Wire__WorkerQuery *workers;
    struct error err = {0};

    (void)state;
    assert_int_equal(json_wire_get(&m, &azulejo__wire__job_query__descriptor, NULL, 0, &err), STATUS_OK);
    query = (Azulejo__Wire__JobQuery *)m;
    check_set(m, "job", "12", STATUS_OK);
    check_set(m, "filter", "ended", STATUS_OK);
    check_set(m, "job", "12x", STATUS_ERR_INPUT);
    check_set(m, "job", "", STATUS_ERR_INPUT);
    check_set(m, "filter", "END", STATUS_ERR_INPUT);
    check_set(m, "no", "1", STATUS_ERR_INTERNAL);
    assert_int_equal(query->job, 12);
    assert_int_equal(query->filter, AZULEJO__WIRE__JOB_FILTER__JOBS_ENDED);
    json_wire_free(m);
    assert_int_equal(json_wire_get(&m, &azulejo__wire__worker_query__descriptor, NULL, 0, &err), STATUS_OK);
    workers = (Azulejo__Wire__WorkerQuery *)m;
    check_set(m, "name", "lab-3", STATUS_OK);
    check_set(m, "name", "lab-4", STATUS_OK);
    check_set(m, "gone", "1", STATUS_OK);
    check_set(m, "name", "\xff", STATUS_ERR_INPUT);
    check_set(m, "gone", "yes", STATUS_ERR_INPUT);
    assert_string_equal(workers->name, "lab-4");
    assert_true(workers->gone);
    json_wire_free(m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_all_messages_are_found),
        cmocka_unit_test(test_round_trips),
        cmocka_unit_test(test_cut_texts),
        cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_form),
        cmocka_unit_test(test_words),
        cmocka_unit_test(test_choice_fields),
        cmocka_unit_test(test_refusals),
        cmocka_unit_test(test_set),
    };

    find_messages(&azulejo__wire__envelope__descriptor);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
