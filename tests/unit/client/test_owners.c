/* Who rendered which tile: a coordinator that says the impossible, and workers that are many or not known. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "client/farm/owners.h"
#include "protocol/message.h"

enum { WIDTH = 40, HEIGHT = 20, TILES = 3 * 2 };

/* An answer as from the wire: each tile has one share, of worker 1. */
static Azulejo__Wire__Envelope *answer_of(const char *const *names, uint32_t count)
{
    Azulejo__Wire__Envelope plain = AZULEJO__WIRE__ENVELOPE__INIT, *answer;
    Azulejo__Wire__FrameTiles tiles = AZULEJO__WIRE__FRAME_TILES__INIT;
    Azulejo__Wire__FrameTile tile[TILES], *tile_pointers[TILES];
    Azulejo__Wire__FrameShare share[TILES], *share_pointers[TILES];
    Azulejo__Wire__FrameWorker worker[64], *worker_pointers[64];
    uint8_t bytes[16384];
    size_t size;

    for (uint32_t i = 0; i < TILES; i++) {
        azulejo__wire__frame_tile__init(tile_pointers[i] = &tile[i]);
        azulejo__wire__frame_share__init(share_pointers[i] = &share[i]);
        share[i].worker = share[i].thread = 1;
        share[i].units = share[i].samples = 2;
        tile[i].n_shares = 1;
        tile[i].shares = &share_pointers[i];
        tile[i].units = 2;
        tile[i].samples = 2;
    }
    for (uint32_t i = 0; i < count; i++) {
        azulejo__wire__frame_worker__init(worker_pointers[i] = &worker[i]);
        worker[i].name = (char *)names[i];
    }
    tiles.width = WIDTH;
    tiles.height = HEIGHT;
    tiles.n_tiles = TILES;
    tiles.tiles = tile_pointers;
    tiles.n_workers = count;
    tiles.workers = worker_pointers;
    plain.body_case = AZULEJO__WIRE__ENVELOPE__BODY_FRAME_TILES;
    plain.frame_tiles = &tiles;
    size = azulejo__wire__envelope__get_packed_size(&plain);
    assert_true(size <= sizeof bytes);
    azulejo__wire__envelope__pack(&plain, bytes);
    assert_int_equal(message_unpack(&answer, bytes, size, NULL), STATUS_OK);
    return answer;
}

static Azulejo__Wire__Envelope *plain_answer(void)
{
    static const char *const names[] = {"ana", "bruno"};

    return answer_of(names, 2);
}

static void refuse(Azulejo__Wire__Envelope *answer)
{
    struct owners owners;
    struct error err = {0};

    assert_int_equal(owners_take(&owners, answer, &err), STATUS_ERR_PROTOCOL);
    owners_release(&owners);
}

static void impossible_answers_are_refused(void **state)
{
    Azulejo__Wire__Envelope *answer = plain_answer();

    (void)state;
    answer->frame_tiles->width = 0;
    refuse(answer);
    answer = plain_answer();
    answer->frame_tiles->width = UINT32_MAX;
    refuse(answer);
    answer = plain_answer();
    answer->frame_tiles->height = HEIGHT + 16; /* one row of tiles more than it sends */
    refuse(answer);
    answer = plain_answer();
    answer->frame_tiles->tiles[TILES - 1]->shares[0]->worker = 3; /* of two */
    refuse(answer);
}

static void what_is_not_known_is_said(void **state)
{
    Azulejo__Wire__Envelope *answer = plain_answer();
    struct owners owners;
    struct error err = {0};
    size_t shares = answer->frame_tiles->tiles[2]->n_shares;
    uint32_t thread;

    (void)state;
    answer->frame_tiles->tiles[0]->shares[0]->worker = 0;
    answer->frame_tiles->tiles[1]->shares[0]->worker = 2;
    answer->frame_tiles->tiles[1]->shares[0]->thread = UINT32_MAX;
    answer->frame_tiles->tiles[2]->n_shares = 0;
    answer->frame_tiles->tiles[3]->units = 9; /* more than its share */
    assert_int_equal(owners_take(&owners, answer, &err), STATUS_OK);
    assert_int_equal(owners.worker_count, 3);
    assert_int_equal(owners.tiles_empty, 1);
    assert_int_equal(owners.tiles_cut, 1);
    assert_string_equal(owners.workers[0].name, "ana");
    assert_string_equal(owners.workers[0].color_words, "red");
    assert_string_equal(owners.workers[1].color_words, "green");
    assert_string_equal(owners.workers[2].name, "not known");
    assert_string_equal(owners.workers[2].color_words, "grey");
    assert_ptr_equal(owners_of_tile(&owners, 0, &thread), &owners.workers[2]);
    assert_ptr_equal(owners_of_tile(&owners, 1, &thread), &owners.workers[1]);
    assert_null(owners_of_tile(&owners, 2, &thread));
    /* Three tiles: two of 16x4 at the lower edge and one of 8x4. */
    assert_int_equal(owners.workers[0].samples, 2 * (2 * 16 * 4 + 8 * 4));
    answer->frame_tiles->tiles[2]->n_shares = shares; /* so that they are freed, too */
    owners_release(&owners);
    memset(&owners, 0, sizeof owners);
    owners_release(&owners); /* after a failure, too */
}

/* Sorted as people count, disarmed, and of different colours as long as there are any. */
static void many_workers_are_told_apart(void **state)
{
    static char texts[30][16];
    const char *names[30];
    Azulejo__Wire__Envelope *answer;
    struct owners owners;
    struct error err = {0};

    (void)state;
    for (uint32_t i = 0; i < 30; i++) {
        snprintf(texts[i], sizeof texts[i], "lab-%u", 30 - i);
        names[i] = texts[i];
    }
    names[29] = "lab-1\x1b[31m";
    answer = answer_of(names, 30);
    for (uint32_t i = 0; i < TILES; i++) { /* each worker has a share of some tile */
        Azulejo__Wire__FrameTile *tile = answer->frame_tiles->tiles[i];
        tile->shares[0]->worker = 5 * i + 1;
    }
    assert_int_equal(owners_take(&owners, answer, &err), STATUS_OK);
    assert_int_equal(owners.worker_count, TILES);
    for (uint32_t i = 0; i + 1 < TILES; i++)
        assert_true(strlen(owners.workers[i].name) <= strlen(owners.workers[i + 1].name));
    assert_string_equal(owners.workers[0].name, "lab-5");
    for (uint32_t i = 0; i < TILES; i++)
        for (uint32_t k = 0; k < i; k++)
            assert_memory_not_equal(owners.workers[i].color, owners.workers[k].color, 3);
    owners_release(&owners);
    answer = answer_of(&names[29], 1);
    assert_int_equal(owners_take(&owners, answer, &err), STATUS_OK);
    assert_string_equal(owners.workers[0].name, "lab-1?[31m");
    owners_release(&owners);
}

static void pictures_have_limits(void **state)
{
    struct owners owners;
    struct image8 image = {0}, over = {.width = WIDTH, .height = HEIGHT - 1, .channels = 3, .bits = 8};
    struct error err = {0};

    (void)state;
    assert_int_equal(owners_take(&owners, plain_answer(), &err), STATUS_OK);
    assert_int_equal(owners_picture(&image, &owners, 2, &over, &err), STATUS_ERR_PROTOCOL);
    assert_int_equal(owners_picture(&image, &owners, IMAGE_SIDE_MAX / WIDTH + 1, NULL, &err), STATUS_ERR_LIMIT);
    assert_int_equal(owners_picture(&image, &owners, 0, NULL, &err), STATUS_OK);
    assert_int_equal(image.width, WIDTH * (512 / WIDTH));
    image8_release(&image);
    owners_release(&owners);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(impossible_answers_are_refused),
        cmocka_unit_test(what_is_not_known_is_said),
        cmocka_unit_test(many_workers_are_told_apart),
        cmocka_unit_test(pictures_have_limits),
    };
    return cmocka_run_group_tests_name("owners", tests, NULL, NULL);
}
