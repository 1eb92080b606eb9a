/* The scene cache: which frames and settings share a slot, and what it keeps. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>

#include "common/base/buffer.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/scene/effects.h"
#include "tests/support/scene_builder.h"
#include "worker/cache/cache_writer.h"
#include "worker/scene_cache.h"
#include "tests/support/scratch_folder.h"

struct stage {
    char folder[SCRATCH_PATH];
    struct scene_builder builder;
    struct scene_node node;
    struct scene_channel channel;
    float times[2], values[6];
    struct digest digest;
    struct blob_cache *blobs;
    struct pool *pool;
    struct scene_cache *cache;
    struct render_settings settings;
    unsigned settled;
};

static void nothing_missing(void *user, const struct scene_blob *blobs, size_t count)
{
    (void)user;
    (void)blobs;
    fail_msg("%zu blobs are missing", count);
}

static void count_settled(void *user, struct scene_slot *slot)
{
    struct stage *s = user;

    (void)slot;
    s->settled++;
}

static void ignore(void *user) { (void)user; }

static void store(struct stage *s, const void *data, size_t size, struct digest *digest)
{
    struct cache_writer *writer;
    struct cached_blob *blob;

    assert_int_equal(digest_of(digest, data, size), STATUS_OK);
    assert_int_equal(cache_writer_new(&writer, s->blobs, digest, size, NULL), STATUS_OK);
    assert_int_equal(cache_writer_add(writer, data, size, NULL), STATUS_OK);
    assert_int_equal(cache_writer_finish(writer, &blob, NULL), STATUS_OK);
    cached_blob_release(blob);
}

/* A sphere that moves along X if asked, in the blob cache. */
static struct stage *stage_new(int moves)
{
    struct scene_cache_callbacks callbacks = {nothing_missing, count_settled, NULL};
    struct stage *s = calloc(1, sizeof *s);
    struct scene_builder *b;
    struct buffer packed = BUFFER_INIT;
    struct digest digest;
    struct error err = {0};

    assert_non_null(s);
    log_setup("test", LOG_LEVEL_ERROR);
    scratch_folder(s->folder);
    assert_int_equal(blob_cache_open(&s->blobs, s->folder, 1 << 30, NULL), STATUS_OK);
    assert_int_equal(pool_new(&s->pool, 2, ignore, NULL, NULL), STATUS_OK);
    callbacks.user = s;
    assert_int_equal(scene_cache_new(&s->cache, s->blobs, s->pool, callbacks, NULL), STATUS_OK);
    s->settings = builder_settings(16, 16, 1);

    b = &s->builder;
    builder_init(b);
    builder_lambert(b, 0.5f);
    builder_place(b, builder_sphere(b, 8, 1), builder_last_material(b), vec3_splat(1), vec3_splat(0));
    builder_camera(b, vec3_make(0, 0, 4), vec3_splat(0), 1);
    scene_node_default(&s->node);
    s->times[1] = s->values[3] = 1;
    s->channel = (struct scene_channel){.path = PATH_TRANSLATION,
                                        .interpolation = INTERPOLATE_LINEAR,
                                        .key_count = 2,
                                        .components = 3,
                                        .times = s->times,
                                        .values = s->values};
    if (moves) {
        b->scene.nodes = &s->node;
        b->scene.channels = &s->channel;
        b->scene.node_count = b->scene.channel_count = 1;
        b->scene.instances[0].node = 0;
    }
    for (size_t i = 0; i < b->blob_count; i++)
        store(s, b->blobs[i].data, b->blobs[i].size_bytes, &digest);
    if (scene_pack(&b->scene, &packed, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    store(s, packed.data, packed.size, &s->digest);
    buffer_release(&packed);
    return s;
}

static void stage_free(struct stage *s)
{
    char command[128];

    pool_free(s->pool);
    scene_cache_free(s->cache);
    blob_cache_close(s->blobs);
    builder_release(&s->builder);
    snprintf(command, sizeof command, "rm -rf %s", s->folder);
    assert_int_equal(system(command), 0);
    free(s);
}

static struct scene_slot *acquire(struct stage *s, uint32_t frame)
{
    struct scene_slot *slot;

    assert_int_equal(scene_cache_acquire(s->cache, &s->digest, &s->settings, frame, &slot, NULL), STATUS_OK);
    return slot;
}

static void pause_briefly(void)
{
    const struct timespec a_moment = {0, 1000000};

    nanosleep(&a_moment, NULL);
}

/* The loop: until the slot is READY or BROKEN. */
static void wait_settled(struct stage *s, const struct scene_slot *slot)
{
    while (scene_slot_state(slot) < SCENE_READY) {
        struct pool_task *next, *done = pool_take_done(s->pool);
        if (!done)
            pause_briefly();
        for (; done; done = next) {
            next = done->next;
            assert_true(scene_cache_task_done(s->cache, done));
        }
    }
}

static void wait_for(struct stage *s, const struct scene_slot *slot)
{
    wait_settled(s, slot);
    if (scene_slot_state(slot) != SCENE_READY)
        fail_msg("%s", scene_slot_error(slot)->text);
}

/* Was the frame kept ready? */
static int is_kept(struct stage *s, uint32_t frame)
{
    struct scene_slot *slot = acquire(s, frame);
    int kept = scene_slot_state(slot) == SCENE_READY;

    wait_for(s, slot);
    scene_slot_release(slot);
    return kept;
}

static void test_still_scene(void **state)
{
    struct stage *s = stage_new(0);
    struct scene_slot *slot = acquire(s, 1), *other;

    (void)state;
    assert_ptr_equal(acquire(s, 5), slot); /* not known yet */
    wait_for(s, slot);
    assert_int_equal(s->settled, 1);
    assert_true(scene_slot_shows(slot, 1) && scene_slot_shows(slot, 5));
    assert_non_null(scene_slot_render(slot));
    other = acquire(s, 99); /* known */
    assert_ptr_equal(other, slot);
    for (int i = 0; i < 3; i++)
        scene_slot_release(slot);
    assert_true(is_kept(s, 7));
    stage_free(s);
}

static void test_moving_scene(void **state)
{
    struct stage *s = stage_new(1);
    struct scene_slot *first = acquire(s, 0), *second = acquire(s, 3), *third, *again;
    struct error err = {0};

    (void)state;
    assert_ptr_equal(first, second); /* it may be good for both */
    wait_for(s, first);
    assert_true(scene_slot_shows(first, 0));
    assert_false(scene_slot_shows(second, 3));
    mem_fault_arm(0, 1);
    assert_int_equal(scene_slot_change(&second, 3, &err), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    assert_ptr_equal(first, second);
    assert_int_equal(scene_slot_change(&second, 3, &err), STATUS_OK);
    assert_ptr_not_equal(first, second);
    third = acquire(s, 7); /* now it is known: no waiting for another frame's slot */
    assert_ptr_not_equal(third, first);
    assert_ptr_not_equal(third, second);
    again = acquire(s, 7);
    assert_ptr_equal(third, again);
    scene_slot_release(again);
    wait_for(s, second);
    wait_for(s, third);
    assert_true(scene_slot_shows(second, 3) && !scene_slot_shows(second, 0));
    assert_ptr_not_equal(scene_slot_render(first), scene_slot_render(second));
    again = acquire(s, 0);
    assert_ptr_equal(again, first);
    scene_slot_release(again);
    /* Of the frames that nobody holds only the one used last stays. */
    assert_int_equal(s->settled, 3);
    scene_slot_release(second); /* used before the others */
    scene_slot_release(third);
    assert_true(is_kept(s, 7));
    assert_false(is_kept(s, 3));
    scene_slot_release(first);
    stage_free(s);
}

/* Another value of any setting is another slot. */
static void test_settings(void **state)
{
    struct stage *s = stage_new(0);
    struct scene_slot *slots[8];

    (void)state;
    slots[0] = acquire(s, 0);
#define ANOTHER(i, statement)                         \
    do {                                              \
        struct render_settings before = s->settings;  \
        statement;                                    \
        slots[i] = acquire(s, 0);                     \
        s->settings = before;                         \
    } while (0)
    ANOTHER(1, s->settings.seed = 4);
    ANOTHER(2, s->settings.fps = 25);
    ANOTHER(3, s->settings.shutter = 0.5f);
    ANOTHER(4, s->settings.lens_radius = 0);
    ANOTHER(5, s->settings.focus_distance = 2);
    ANOTHER(6, s->settings.without = EFFECT_CAUSTICS);
    ANOTHER(7, s->settings.aovs = 1u << AOV_DEPTH);
#undef ANOTHER
    for (int i = 0; i < 8; i++)
        for (int j = 0; j < i; j++)
            assert_ptr_not_equal(slots[i], slots[j]);
    for (int i = 0; i < 8; i++)
        wait_for(s, slots[i]);
    for (int i = 0; i < 8; i++)
        scene_slot_release(slots[i]);
    /* Eight lie idle: the last ones stay. */
    assert_false(is_kept(s, 0));
    stage_free(s);
}

/* A frame that finds no memory is built after all once the idle scenes are gone. */
static void test_no_memory(void **state)
{
    struct stage *s = stage_new(0);
    struct scene_slot *held = acquire(s, 0), *idle, *slot;

    (void)state;
    wait_for(s, held);
    for (int tries = 0; tries < 2; tries++) {
        s->settings.seed = 1;
        idle = acquire(s, 0);
        wait_for(s, idle);
        scene_slot_release(idle);
        s->settings.seed = 2 + (uint64_t)tries;
        /* The build fails at its first allocation, or half way. */
        s->settled = 0;
        mem_fault_arm(1 + 20 * tries, 1);
        slot = acquire(s, 0);
        wait_for(s, slot);
        assert_int_equal(mem_fault_count(), 1);
        mem_fault_arm(-1, 0);
        assert_int_equal(s->settled, 1); /* its owner is told once */
        assert_int_equal(scene_slot_error(slot)->code, STATUS_OK);
        s->settings.seed = 1;
        assert_false(is_kept(s, 0));
        s->settings.seed = 2 + (uint64_t)tries;
        assert_true(is_kept(s, 0)); /* while it is held */
        scene_slot_release(slot);
    }
    assert_int_equal(scene_slot_state(held), SCENE_READY);
    scene_slot_release(held);
    stage_free(s);
}

/* Where there is nothing to drop, or it does not help, it fails. */
static void test_no_memory_at_all(void **state)
{
    struct stage *s = stage_new(0);
    struct scene_slot *slot;

    (void)state;
    mem_fault_arm(1, 1000000);
    slot = acquire(s, 0);
    wait_settled(s, slot);
    mem_fault_arm(-1, 0);
    assert_int_equal(scene_slot_state(slot), SCENE_BROKEN);
    assert_int_equal(scene_slot_error(slot)->code, STATUS_ERR_NO_MEMORY);
    assert_int_equal(s->settled, 1);
    scene_slot_release(slot);

    assert_false(is_kept(s, 0));
    assert_true(is_kept(s, 0));
    s->settings.seed = 2;
    render_memory_limit(1);
    slot = acquire(s, 0);
    wait_settled(s, slot);
    render_memory_limit(0);
    assert_int_equal(scene_slot_state(slot), SCENE_BROKEN);
    assert_int_equal(scene_slot_error(slot)->code, STATUS_ERR_NO_MEMORY);
    scene_slot_release(slot);
    stage_free(s);
}

/* Two builds that fail together: the second is done again too, though the first took all that
 * lay idle. */
static void test_no_memory_twice(void **state)
{
    struct stage *s = stage_new(0);
    struct scene_slot *slots[2];
    struct pool_task *failed[2], *next;
    unsigned count = 0;

    (void)state;
    assert_false(is_kept(s, 0));
    render_memory_limit(1);
    for (int i = 0; i < 2; i++) {
        s->settings.seed = 2 + (uint64_t)i;
        slots[i] = acquire(s, 0);
    }
    while (count < 2) {
        for (struct pool_task *done = pool_take_done(s->pool); done; done = next) {
            next = done->next;
            failed[count++] = done;
        }
        pause_briefly();
    }
    render_memory_limit(0);
    for (int i = 0; i < 2; i++)
        assert_true(scene_cache_task_done(s->cache, failed[i]));
    for (int i = 0; i < 2; i++) {
        wait_for(s, slots[i]);
        scene_slot_release(slots[i]);
    }
    stage_free(s);
}

static void test_equal_settings(void **state)
{
    struct render_settings a, b;

    (void)state;
    render_settings_default(&a);
    b = a;
    assert_true(render_settings_equal(&a, &b));
#define DIFFERS(field)                               \
    do {                                             \
        b = a;                                       \
        b.field = b.field + 1;                       \
        assert_false(render_settings_equal(&a, &b)); \
    } while (0)
    DIFFERS(width);
    DIFFERS(height);
    DIFFERS(spp);
    DIFFERS(max_depth);
    DIFFERS(seed);
    DIFFERS(camera);
    DIFFERS(env_rotate_deg);
    DIFFERS(env_strength);
    DIFFERS(env_sampling);
    DIFFERS(isa);
    DIFFERS(fps);
    DIFFERS(shutter);
    DIFFERS(lens_radius);
    DIFFERS(focus_distance);
    DIFFERS(without);
    DIFFERS(aovs);
    DIFFERS(exr_names);
    DIFFERS(sampler);
    DIFFERS(light_choice);
    DIFFERS(texture_filter);
    DIFFERS(pixel_filter);
    DIFFERS(filter_width);
    DIFFERS(bvh_quality);
    DIFFERS(not_robust);
    DIFFERS(no_roulette);
    DIFFERS(clamp);
    DIFFERS(whole_width);
    DIFFERS(whole_height);
    DIFFERS(region_x);
    DIFFERS(region_y);
#undef DIFFERS
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_still_scene),
        cmocka_unit_test(test_moving_scene),
        cmocka_unit_test(test_settings),
        cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_no_memory_at_all),
        cmocka_unit_test(test_no_memory_twice),
        cmocka_unit_test(test_equal_settings),
    };

    return cmocka_run_group_tests_name("scene_cache", tests, NULL, NULL);
}
