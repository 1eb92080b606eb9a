/* Whose results are not believed, which frames they rendered, and what is to be rendered again. */
#include <inttypes.h>
#include <stdio.h>

#include "common/base/bytes.h"
#include "common/base/memory.h"
#include "coordinator/store/store_parts.h"

status store_deliverers_of(struct store *store, const char *label,
                           status (*visit)(void *user, uint32_t number, struct error *err), void *user,
                           struct error *err)
{
    struct sql_rows rows =
        sql_read(store,
                 "SELECT number FROM deliverers d WHERE label=?1 OR (instr(?1, '@')=0 AND"
                 " substr(label, 1, length(?1)+1)=?1||'@') OR (label='' AND ?1=(SELECT name FROM workers w"
                 " WHERE w.host=d.host AND w.process=d.process ORDER BY joined_at DESC LIMIT 1))",
                 SQL_VALUES(sql_text(label)), "the deliverers cannot be read", err);

    while (sql_next(&rows))
        rows.result = visit(user, (uint32_t)column_number(rows.row, 0), err);
    return sql_end(&rows);
}

status store_distrust(struct store *store, const struct distrusted *who, struct error *err)
{
    return sql_note(store,
                    "INSERT INTO deliverers (number, host, process, software, first_seen, distrusted)"
                    " VALUES (?1, '', 0, '', 0, ?2) ON CONFLICT (number) DO UPDATE SET"
                    " distrusted=min(coalesce(distrusted, excluded.distrusted), excluded.distrusted)",
                    SQL_VALUES(sql_number(who->number), sql_number(who->since)),
                    "whose results are not believed cannot be stored", err);
}

status store_distrusted_load(struct store *store,
                             status (*visit)(void *user, const struct distrusted *who, struct error *err), void *user,
                             struct error *err)
{
    struct sql_rows rows = sql_select(store, "SELECT number, distrusted FROM deliverers WHERE distrusted IS NOT NULL",
                                      NULL, 0, "whose results are not believed cannot be read", err);

    while (sql_next(&rows)) {
        const struct distrusted who = {(uint32_t)column_number(rows.row, 0), sqlite3_column_int64(rows.row, 1)};
        rows.result = visit(user, &who, err);
    }
    return sql_end(&rows);
}

/* ---- answers for units that are to be rendered again ------------------------------------------ */

static void unit_text(char out[96], const struct unit_vote *v)
{
    snprintf(out, 96, "%" PRIu64 "/%" PRIu32 "/%" PRIu32 "/%" PRIu32 "/%" PRIu32, v->job, v->frame, v->tile, v->group,
             v->pass);
}

status store_vote_add(struct store *store, const struct unit_vote *v, struct error *err)
{
    char unit[96], hex[DIGEST_HEX_SIZE] = "";

    unit_text(unit, v);
    if (v->has_digest)
        digest_to_hex(&v->digest, hex);
    return sql_note(store, "INSERT OR REPLACE INTO votes (unit, worker, place, epoch_floor, hash, digest) VALUES (?, ?, ?, ?, ?, ?)",
                    SQL_VALUES(sql_text(unit), sql_text(v->label), sql_number(v->place),
                               sql_number((int64_t)v->epoch_floor), sql_number((int64_t)v->hash), sql_text(hex)),
                    "what is to be rendered again cannot be stored", err);
}

status store_votes_remove(struct store *store, const struct unit_vote *v, struct error *err)
{
    char unit[96];

    unit_text(unit, v);
    return sql_note(store, "DELETE FROM votes WHERE unit=?", SQL_VALUES(sql_text(unit)),
                    "what was rendered again cannot be stored", err);
}

status store_votes_load(struct store *store, status (*visit)(void *user, const struct unit_vote *vote, struct error *err),
                        void *user, struct error *err)
{
    struct sql_rows rows = sql_select(store, "SELECT unit, worker, place, epoch_floor, hash, digest FROM votes ORDER BY unit, place",
                                      NULL, 0, "what is to be rendered again cannot be read", err);

    while (sql_next(&rows)) {
        struct unit_vote v = {.place = (uint32_t)column_number(rows.row, 2), .epoch_floor = column_number(rows.row, 3),
                              .hash = (uint64_t)sqlite3_column_int64(rows.row, 4)};
        char unit[96], hex[DIGEST_HEX_SIZE];
        column_text(rows.row, 0, unit, sizeof unit);
        column_text(rows.row, 1, v.label, sizeof v.label);
        column_text(rows.row, 5, hex, sizeof hex);
        v.has_digest = digest_from_hex(&v.digest, hex) == STATUS_OK;
        if (sscanf(unit, "%" SCNu64 "/%" SCNu32 "/%" SCNu32 "/%" SCNu32 "/%" SCNu32, &v.job, &v.frame, &v.tile,
                   &v.group, &v.pass) == 5)
            rows.result = visit(user, &v, err);
    }
    return sql_end(&rows);
}

status store_frames_made(struct store *store,
                         status (*visit)(void *user, uint64_t job, uint32_t frame, const struct frame_makers *makers,
                                         struct error *err),
                         void *user, struct error *err)
{
    struct sql_rows rows = sql_read(store,
                                    "SELECT job, frame, deliverers, done_at FROM frames WHERE deliverers IS NOT NULL"
                                    " ORDER BY job, frame",
                                    NULL, 0, "who rendered the frames cannot be read", err);

    while (sql_next(&rows)) {
        struct frame_makers makers = {.deliverers = BUFFER_INIT, .done_at = sqlite3_column_int64(rows.row, 3)};
        makers.deliverers.data = (uint8_t *)(uintptr_t)sqlite3_column_blob(rows.row, 2); /* only read */
        makers.deliverers.size = (size_t)sqlite3_column_bytes(rows.row, 2);
        rows.result = visit(user, column_number(rows.row, 0), (uint32_t)column_number(rows.row, 1), &makers, err);
    }
    return sql_end(&rows);
}
