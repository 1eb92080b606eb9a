/* The workers' names, what people do to workers, and what is kept of those that left. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <sqlite3.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/farm/roster.h"
#include "tests/support/sim_farm.h"

static uint32_t sessions;

/* Joins or, with STATUS_ERR_LIMIT, does not. `key`: the name of its key; "": others share it. */
static status join_with(struct farm *farm, struct farm_worker *worker, const char *key, const char *host,
                        const char *wish, int chosen, uint64_t instance, struct farm_worker **replaced)
{
    struct error err = {0};
    status s;

    memset(worker, 0, sizeof *worker);
    worker->held.session = ++sessions;
    worker->threads = 1;
    worker->instance = instance;
    snprintf(worker->deliverer.host, sizeof worker->deliverer.host, "%s", host);
    s = roster_join(farm, worker, &(struct worker_claim){host, wish, chosen, key}, replaced, &err);
    if (s == STATUS_OK)
        assert_int_equal(farm_worker_add(farm, worker, &err), STATUS_OK);
    return s;
}

static status join(struct farm *farm, struct farm_worker *worker, const char *host, const char *wish, int chosen,
                   uint64_t instance, struct farm_worker **replaced)
{
    return join_with(farm, worker, "", host, wish, chosen, instance, replaced);
}

static void joins_as(struct farm *farm, struct farm_worker *worker, const char *host, const char *wish,
                     uint64_t instance, const char *name)
{
    struct farm_worker *replaced;

    assert_int_equal(join(farm, worker, host, wish, 0, instance, &replaced), STATUS_OK);
    assert_null(replaced);
    assert_string_equal(worker->label, name);
    assert_ptr_equal(roster_find(farm, name), worker);
}

static void hosts_make_names(void **state)
{
    struct sim *sim = *state;
    struct farm *farm = &sim->farm;
    struct farm_worker w[8], *replaced;
    char host[200];

    joins_as(farm, &w[0], "render", "", 1, "render");
    joins_as(farm, &w[1], "render", "", 2, "render-2");
    joins_as(farm, &w[2], "render", "", 3, "render-3");
    farm_worker_remove(farm, &w[1], 0, 0);
    joins_as(farm, &w[1], "render", "", 4, "render-2");
    joins_as(farm, &w[3], "", "", 5, "worker");
    joins_as(farm, &w[4], "-\xc3\xa4 *b", "", 6, "b");
    memset(host, 'x', sizeof host);
    host[199] = 0;
    assert_int_equal(join(farm, &w[5], host, "", 0, 7, &replaced), STATUS_OK);
    assert_int_equal(join(farm, &w[6], host, "", 0, 8, &replaced), STATUS_OK);
    assert_int_equal(strlen(w[6].label), strlen(w[5].label) + 2);
    /* A name that the coordinator gave is only a wish. */
    joins_as(farm, &w[7], "render", "render-2", 9, "render-4");
    for (int i = 0; i < 8; i++)
        farm_worker_remove(farm, &w[i], 0, 0);
    joins_as(farm, &w[7], "render", "render-2", 9, "render-2");
    farm_worker_remove(farm, &w[7], 0, 0);
}

static int key_is_node(const void *keys, const char *name)
{
    (void)keys;
    return strcmp(name, "node") == 0;
}

/* The first part of a name is that of the key: no other worker can have it. */
static void keys_prove_names(void **state)
{
    static const struct {
        const char *key, *host, *wish;
        int chosen;
        const char *name; /* NULL: refused */
    } table[] = {
        {"node", "node", "", 0, "node"},
        {"node", "node", "", 0, "node@2"},
        {"node", "ws3", "", 0, "node@ws3"},
        {"node", "ws3", "", 0, "node@ws3-2"},
        {"node", "ws3", "gpu", 1, "node@gpu"},
        {"node", "ws3", "gpu", 1, NULL},             /* taken */
        {"node", "ws3", "node@7", 0, "node@7"},      /* as it was called before */
        {"node", "ws3", "other@7", 0, "node@ws3-3"}, /* with another key */
        {"other", "node", "node", 0, "other@node"},
        {"other", "node", "node@ws3", 0, "other@node-2"},
        {"", "node", "", 0, "node-2"},
        {"", "ws3", "node", 1, NULL},
        {"", "ws3", "node", 0, "ws3"},
        {"", "ws3", "node@9", 0, "ws3-2"},
        {"node-2", "h", "", 0, "node-2@h"},
    };
    enum { COUNT = sizeof table / sizeof *table };
    struct sim *sim = *state;
    struct farm *farm = &sim->farm;
    struct farm_worker w[COUNT], *replaced;
    char longest[64], name[WORKER_LABEL_MAX + 1];

    farm->roster.is_key = key_is_node;
    for (size_t i = 0; i < COUNT; i++) {
        status s = join_with(farm, &w[i], table[i].key, table[i].host, table[i].wish, table[i].chosen, i + 1, &replaced);
        assert_int_equal(s, table[i].name ? STATUS_OK : STATUS_ERR_LIMIT);
        assert_string_equal(s == STATUS_OK ? w[i].label : "", table[i].name ? table[i].name : "");
    }
    for (size_t i = 0; i < COUNT; i++)
        if (table[i].name)
            farm_worker_remove(farm, &w[i], 0, 0);
    memset(longest, 'k', 63);
    longest[63] = 0;
    assert_int_equal(join_with(farm, &w[0], longest, "h", longest + 1, 1, 1, &replaced), STATUS_OK);
    snprintf(name, sizeof name, "%s@%s", longest, longest + 1);
    assert_string_equal(w[0].label, name);
    farm_worker_remove(farm, &w[0], 0, 0);
    farm->roster.is_key = NULL;
}

/* Who is blocked for a lie: all of the key, unless other machines have it. */
static void a_key_answers_for_its_workers(void **state)
{
    struct sim_stored *f = *state;
    struct farm *farm = &f->sim->farm;
    struct farm_worker w[5], *replaced;
    struct error err = {0};
    char name[WORKER_LABEL_MAX + 1];

    for (int i = 0; i < 5; i++) {
        static const char *const hosts[] = {"a", "b", "c", "d", "a"};
        assert_int_equal(join_with(farm, &w[i], i == 3 ? "lone" : "k", hosts[i], "", 0, (uint64_t)i + 1, &replaced), STATUS_OK);
        w[i].machine = (uint64_t)hosts[i][0];
    }
    roster_culprit(farm, "lone@d", name);
    assert_string_equal(name, "lone");
    roster_culprit(farm, "plain", name); /* it has left */
    assert_string_equal(name, "plain");
    roster_culprit(farm, "k@a", name);
    assert_string_equal(name, "k@a");
    assert_int_equal(roster_steer(farm, "k@a", WORKER_VERB_BLOCK, "x@y", &err), STATUS_OK);
    assert_int_equal(w[0].hold, WORKER_BLOCKED);
    assert_int_equal(w[4].hold, WORKER_FREE);
    roster_culprit(farm, "k@b", name);
    assert_string_equal(name, "k@b");
    assert_int_equal(roster_steer(farm, "k@b", WORKER_VERB_BLOCK, "x@y", &err), STATUS_OK);
    roster_culprit(farm, "k@c", name); /* the third one */
    assert_string_equal(name, "k");
    assert_int_equal(roster_steer(farm, "k", WORKER_VERB_BLOCK, "x@y", &err), STATUS_OK);
    for (int i = 0; i < 5; i++)
        assert_int_equal(w[i].hold, i == 3 ? WORKER_FREE : WORKER_BLOCKED);
    assert_int_equal(roster_steer(farm, "k@c", WORKER_VERB_UNBLOCK, "x@y", &err), STATUS_ERR_REFUSED);
    assert_int_equal(roster_steer(farm, "k@c", WORKER_VERB_DRAIN, "x@y", &err), STATUS_ERR_REFUSED);
    assert_int_equal(roster_steer(farm, "k", WORKER_VERB_UNBLOCK, "x@y", &err), STATUS_OK);
    assert_int_equal(w[0].hold, WORKER_BLOCKED); /* by its own name */
    assert_int_equal(w[1].hold, WORKER_BLOCKED);
    assert_int_equal(w[2].hold, WORKER_FREE);
    assert_int_equal(w[4].hold, WORKER_FREE);
    for (int i = 0; i < 2; i++)
        assert_int_equal(roster_steer(farm, w[i].label, WORKER_VERB_UNBLOCK, "x@y", &err), STATUS_OK);
    for (int i = 0; i < 5; i++) {
        assert_int_equal(w[i].hold, WORKER_FREE);
        farm_worker_remove(farm, &w[i], 0, 0);
    }
}

static void a_name_has_one_worker(void **state)
{
    struct sim *sim = *state;
    struct farm *farm = &sim->farm;
    struct farm_worker a, b, *replaced;

    assert_int_equal(join(farm, &a, "h", "n", 1, 1, &replaced), STATUS_OK);
    assert_int_equal(join(farm, &b, "h", "n", 1, 2, &replaced), STATUS_ERR_LIMIT);
    assert_ptr_equal(roster_find(farm, "n"), &a);
    /* The same process again. */
    assert_int_equal(join(farm, &b, "h", "n", 1, 1, &replaced), STATUS_OK);
    assert_ptr_equal(replaced, &a);
    assert_ptr_equal(roster_find(farm, "n"), &b);
    assert_false(worker_takes_work(&a));
    farm_worker_remove(farm, &a, 0, 0); /* its old connection closes */
    assert_ptr_equal(roster_find(farm, "n"), &b);
    farm_worker_remove(farm, &b, 0, 0);
    assert_null(roster_find(farm, "n"));
}

/* Many of one host, as in a test of scale: not quadratic. */
static void a_thousand_of_one_host(void **state)
{
    enum { COUNT = 3000 };
    static struct farm_worker workers[COUNT];
    struct sim *sim = *state;
    struct farm_worker *replaced;
    char name[32];

    for (int i = 0; i < COUNT; i++)
        assert_int_equal(join(&sim->farm, &workers[i], "h", "", 0, (uint64_t)i + 1, &replaced), STATUS_OK);
    snprintf(name, sizeof name, "h-%d", COUNT);
    assert_ptr_equal(roster_find(&sim->farm, name), &workers[COUNT - 1]);
    for (int i = 0; i < COUNT; i++)
        farm_worker_remove(&sim->farm, &workers[i], 0, 0);
}

/* Every verb in every state of a worker: the table of roster.h. */
enum { WORKS, PAUSED, DRAINED, BLOCKED, AWAY, AWAY_BLOCKED, CASES };

static void every_verb_in_every_state(void **state)
{
    enum { SAME = -1, REFUSED = -2, MISSING = -3 };
    static const int outcomes[4][CASES] = {
        [WORKER_VERB_DRAIN] = {WORKER_DRAINED, WORKER_DRAINED, SAME, REFUSED, MISSING, REFUSED},
        [WORKER_VERB_RESUME] = {SAME, REFUSED, WORKER_FREE, REFUSED, MISSING, REFUSED},
        [WORKER_VERB_BLOCK] = {WORKER_BLOCKED, WORKER_BLOCKED, WORKER_BLOCKED, SAME, WORKER_BLOCKED, SAME},
        [WORKER_VERB_UNBLOCK] = {SAME, SAME, REFUSED, WORKER_FREE, MISSING, WORKER_FREE},
    };
    struct sim_stored *f = *state;
    char name[32];

    for (int verb = 0; verb < 4; verb++) {
        for (int from = 0; from < CASES; from++) {
            struct farm *farm = &f->sim->farm;
            struct farm_worker worker, *replaced;
            struct error err = {0};
            int wanted = outcomes[verb][from];
            enum worker_hold before;
            status s;

            snprintf(name, sizeof name, "w-%d-%d", verb, from);
            if (from < AWAY)
                assert_int_equal(join(farm, &worker, "h", name, 1, 50, &replaced), STATUS_OK);
            if (from == PAUSED)
                worker.mode = WORKER_MODE_PAUSED;
            if (from == DRAINED)
                assert_int_equal(roster_steer(farm, name, WORKER_VERB_DRAIN, "x@y", &err), STATUS_OK);
            if (from == BLOCKED || from == AWAY_BLOCKED)
                assert_int_equal(roster_steer(farm, name, WORKER_VERB_BLOCK, "x@y", &err), STATUS_OK);
            before = from < AWAY ? worker.hold : WORKER_FREE;
            s = roster_steer(farm, name, (enum worker_verb)verb, "ada@desk", &err);
            assert_int_equal(s, wanted == REFUSED   ? STATUS_ERR_REFUSED
                                : wanted == MISSING ? STATUS_ERR_NOT_FOUND
                                                    : STATUS_OK);
            assert_int_equal(err.text[0] != 0, s != STATUS_OK);
            if (from >= AWAY)
                wanted = wanted == SAME || wanted == REFUSED ? WORKER_BLOCKED : wanted == MISSING ? WORKER_FREE : wanted;
            else
                wanted = wanted < 0 ? (int)before : wanted;
            if (from < AWAY)
                assert_int_equal(worker.hold, wanted);
            if (from < AWAY)
                farm_worker_remove(farm, &worker, 0, 0);
            /* The coordinator is killed: the same process is what it was, another one is drained no more. */
            sim_stored_restart(f);
            farm = &f->sim->farm;
            assert_int_equal(join(farm, &worker, "h", name, 1, 50, &replaced), STATUS_OK);
            assert_int_equal(worker.hold, wanted);
            if (worker.hold == WORKER_DRAINED || worker.hold == WORKER_BLOCKED)
                assert_true(strcmp(worker.held_by, before == worker.hold || from == AWAY_BLOCKED ? "x@y" : "ada@desk") == 0);
            farm_worker_remove(farm, &worker, 0, 0);
            assert_int_equal(join(farm, &worker, "h", name, 1, 51, &replaced), STATUS_OK);
            assert_int_equal(worker.hold, wanted == WORKER_BLOCKED ? WORKER_BLOCKED : WORKER_FREE);
            farm_worker_remove(farm, &worker, 0, 0);
            if (wanted == WORKER_BLOCKED)
                assert_int_equal(roster_steer(farm, name, WORKER_VERB_UNBLOCK, "x", &err), STATUS_OK);
            assert_null(roster_mark(farm, name));
        }
    }
}

static void names_are_checked(void **state)
{
    struct sim *sim = *state;
    struct error err = {0};

    assert_int_equal(roster_steer(&sim->farm, "a*", WORKER_VERB_BLOCK, "x", &err), STATUS_ERR_INPUT);
    assert_int_equal(roster_steer(&sim->farm, "", WORKER_VERB_BLOCK, "x", &err), STATUS_ERR_INPUT);
}

struct rows {
    struct worker_row row[WORKERS_GONE_MAX + 1];
    size_t count;
};

static status take_row(void *user, const struct worker_row *row, struct error *err)
{
    struct rows *rows = user;

    (void)err;
    assert_true(rows->count <= WORKERS_GONE_MAX);
    rows->row[rows->count++] = *row;
    return STATUS_OK;
}

static size_t gone(struct sim_stored *f, const char *name, struct rows *rows)
{
    struct error err = {0};

    rows->count = 0;
    store_settle(f->store); /* as the answer waits for it */
    assert_int_equal(store_workers_gone(f->store, name, take_row, rows, &err), STATUS_OK);
    return rows->count;
}

static void what_they_did_is_kept(void **state)
{
    static struct rows rows;
    struct sim_stored *f = *state;
    struct farm *farm = &f->sim->farm;
    struct farm_worker worker, *replaced;

    farm->wall_s = 1000;
    assert_int_equal(join(farm, &worker, "h", "a", 1, UINT64_MAX, &replaced), STATUS_OK);
    worker.joined_at = 900;
    worker_save(farm, &worker, NULL);
    assert_int_equal(gone(f, "", &rows), 0); /* it is here */
    worker.units_done = 5;
    worker.samples_done = 50;
    worker.cpu_ns = 500;
    worker_save(farm, &worker, NULL);
    worker.units_done = 7;
    for (int i = 0; i < WORKER_LINES_MAX + 2; i++)
        worker_line_add(farm, &worker, "line %d", i);
    farm->wall_s = 1100;
    worker_save(farm, &worker, "it ended");
    farm_worker_remove(farm, &worker, 0, 0);
    assert_int_equal(gone(f, "b", &rows), 0);
    assert_int_equal(gone(f, "a", &rows), 1);
    assert_int_equal(rows.row[0].units, 7);
    assert_int_equal(rows.row[0].samples, 50);
    assert_int_equal(rows.row[0].cpu_ns, 500);
    assert_int_equal(rows.row[0].connections, 1);
    assert_int_equal(rows.row[0].joined_at, 900);
    assert_int_equal(rows.row[0].left_at, 1100);
    assert_true(rows.row[0].instance == UINT64_MAX);
    assert_string_equal(rows.row[0].why, "it ended");
    assert_int_equal(rows.row[0].line_count, WORKER_LINES_MAX);
    assert_string_equal(rows.row[0].lines[0].text, "line 2");
    assert_int_equal(rows.row[0].lines[0].at, 1000);
    /* It comes again, and the coordinator is killed. */
    assert_int_equal(join(farm, &worker, "h", "a", 1, UINT64_MAX, &replaced), STATUS_OK);
    worker.units_done = 3;
    worker_save(farm, &worker, NULL);
    assert_int_equal(gone(f, "a", &rows), 0);
    farm_worker_remove(farm, &worker, 0, 0);
    sim_stored_restart(f);
    assert_int_equal(gone(f, "a", &rows), 1);
    assert_int_equal(rows.row[0].units, 10);
    assert_int_equal(rows.row[0].connections, 2);
    assert_int_equal(rows.row[0].left_at, 1100);
    assert_string_equal(rows.row[0].why, "the coordinator ended");
    assert_int_equal(rows.row[0].line_count, WORKER_LINES_MAX);
}

static int rows_stored(const struct sim_stored *f)
{
    sqlite3_stmt *statement;
    char path[128];
    sqlite3 *db;
    int count;

    snprintf(path, sizeof path, "%s/queue.sqlite", f->folder);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_prepare_v2(db, "SELECT count(*) FROM workers", -1, &statement, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_step(statement), SQLITE_ROW);
    count = sqlite3_column_int(statement, 0);
    sqlite3_finalize(statement);
    sqlite3_close(db);
    return count;
}

static void the_oldest_are_forgotten(void **state)
{
    static struct rows rows;
    struct sim_stored *f = *state;
    struct worker_row row = {.name = "a", .connections = 1};

    row.instance = 12345; /* one that stays */
    store_worker_later(f->store, &row);
    for (int i = 0; i < WORKERS_GONE_MAX + 10; i++) {
        row.instance = (uint64_t)i + 1;
        row.left_at = 1000 + i;
        store_worker_later(f->store, &row);
    }
    assert_int_equal(gone(f, "", &rows), WORKERS_GONE_MAX);
    assert_int_equal(rows.row[0].left_at, 1000 + WORKERS_GONE_MAX + 9);
    assert_int_equal(rows.row[WORKERS_GONE_MAX - 1].left_at, 1010);
    assert_int_equal(rows_stored(f), WORKERS_GONE_MAX + 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(hosts_make_names, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(a_name_has_one_worker, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(keys_prove_names, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(a_key_answers_for_its_workers, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(a_thousand_of_one_host, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(names_are_checked, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(every_verb_in_every_state, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(what_they_did_is_kept, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(the_oldest_are_forgotten, sim_stored_set_up, sim_stored_tear_down),
    };
    return cmocka_run_group_tests_name("roster", tests, NULL, NULL);
}
