#include "client/farm/job_choice.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "client/follow/job_info.h"
#include "client/terminal/must.h"
#include "client/terminal/parse.h"
#include "client/terminal/wildcard.h"
#include "common/base/memory.h"
#include "protocol/message.h"

enum {
    SHOWN_MAX = 20,              /* jobs that a question lists */
    NAME_MAX_BYTES = 255,        /* of a job */
};
/* Jobs that a sentence names. */
enum { IDLE_SHOWN = 3, NAMED_SHOWN = 5 };

static int is_number(const char *text) { return *text && text[strspn(text, "0123456789")] == 0; }

/* Bits of JobState. */
static status parse_states(const char *text, unsigned *out, struct error *err)
{
    *out = 0;
    for (const char *at = text;; at++) {
        size_t length = strcspn(at, ",");
        unsigned found = job_state_find(at, length);

        *out |= found;
        if (!found)
            return error_set(err, STATUS_ERR_USAGE, "--state: '%.*s' is not a state; they are %s", (int)length, at,
                             job_state_words());
        at += length;
        if (!*at)
            return STATUS_OK;
    }
}

status job_word_check(const char *text, struct error *err)
{
    uint64_t job;

    if (!text[0])
        return error_set(err, STATUS_ERR_USAGE, "an empty text is not a job's name");
    if (strlen(text) > NAME_MAX_BYTES)
        return error_set(err, STATUS_ERR_USAGE, "'%.20s...' is not a job: a name has at most %d bytes", text,
                         NAME_MAX_BYTES);
    return is_number(text) ? parse_job(text, &job, err) : STATUS_OK;
}

status job_choice_check(const struct job_choice *choice, const struct positionals *rest, struct error *err)
{
    unsigned states;

    if (rest->count == 0 && !choice->states && !choice->mine && !choice->ended_before)
        return error_set(err, STATUS_ERR_USAGE,
                         "which job? Give numbers, names (with wildcards in quotes), --state or --mine");
    for (size_t i = 0; i < rest->count; i++)
        TRY(job_word_check(rest->items[i], err));
    return choice->states ? parse_states(choice->states, &states, err) : STATUS_OK;
}

static void keep_answer(struct chosen_jobs *out, Azulejo__Wire__Envelope *answer)
{
    MUST_GROW(out->answers, out->answer_capacity, out->answer_count + 1);
    out->answers[out->answer_count++] = answer;
}

static void add(struct chosen_jobs *out, uint64_t job, const Azulejo__Wire__JobInfo *info)
{
    MUST_GROW(out->items, out->capacity, out->count + 1);
    out->items[out->count++] = (struct chosen_job){job, info};
}

/* What decides about one job. */
struct filter {
    const struct positionals *rest;
    unsigned states;                                /* --state; 0: every state in which the verb does something */
    const struct job_verb *verb;                    /* NULL: any */
    const char *owner;                              /* NULL: anybody's */
    int64_t ended_before;                           /* 0: at any time, or not yet */
    unsigned char seen[OPTIONS_POSITIONAL_MAX];     /* such a job exists, whatever its state and owner */
    const Azulejo__Wire__JobInfo *idle[IDLE_SHOWN]; /* that match, but the verb would do nothing */
    size_t idle_count;
};

/* An older coordinator does not say it. */
static int offers(const Azulejo__Wire__JobInfo *info, const struct job_verb *verb)
{
    for (size_t i = 0; i < info->n_verbs; i++)
        if (strcmp(info->verbs[i], verb->name) == 0)
            return 1;
    return info->n_verbs == 0 && (verb->states >> info->state & 1);
}

static int fits(struct filter *f, const Azulejo__Wire__JobInfo *info)
{
    int named = 0, matched = f->rest->count == 0;

    for (size_t i = 0; i < f->rest->count; i++) {
        const char *text = f->rest->items[i];
        int number = is_number(text);
        int is_meant = number ? strtoull(text, NULL, 10) == info->job : wildcard_fits(text, info->name);

        f->seen[i] |= is_meant != 0;
        named |= number && is_meant;
        matched |= !number && is_meant;
    }

    if (f->owner && strcmp(info->owner, f->owner) != 0)
        return 0;
    if (f->states && !(f->states >> info->state & 1))
        return 0;
    if (f->ended_before && (info->finished_at == 0 || info->finished_at >= f->ended_before))
        return 0;
    if (named || (matched && (f->states || !f->verb || offers(info, f->verb))))
        return 1;
    if (matched && f->idle_count++ < IDLE_SHOWN)
        f->idle[f->idle_count - 1] = info;
    return 0;
}

/* All jobs, page by page from the newest. */
static status find_all(struct connection *c, struct filter *f, struct chosen_jobs *out, struct error *err)
{
    Azulejo__Wire__JobQuery query = AZULEJO__WIRE__JOB_QUERY__INIT;
    uint64_t older = 1;

    while (older > 0) {
        Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT, *answer = NULL;
        const Azulejo__Wire__JobList *list;

        question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_QUERY;
        question.job_query = &query;
        TRY(job_ask(c, &question, 0, &answer, err));
        keep_answer(out, answer);
        list = answer->job_list;
        for (size_t i = 0; i < list->n_jobs; i++)
            if (fits(f, list->jobs[i]))
                add(out, list->jobs[i]->job, list->jobs[i]);
        older = list->n_jobs ? list->older : 0;
        query.before = list->n_jobs ? list->jobs[0]->job : 0;
    }
    return STATUS_OK;
}

static int compare(const void *a, const void *b)
{
    uint64_t left = ((const struct chosen_job *)a)->job, right = ((const struct chosen_job *)b)->job;

    return (left > right) - (left < right);
}

/* Jobs match, but the verb would change none of them. */
static status report_idle(const struct filter *f, struct error *err)
{
    char list[IDLE_SHOWN * 320] = "", name[256], more[48] = "";
    size_t used = 0;

    for (size_t i = 0; i < f->idle_count && i < IDLE_SHOWN; i++)
        used += (size_t)snprintf(list + used, sizeof list - used, "%sjob %" PRIu64 " (%s) is %s", i ? ", " : "",
                                 f->idle[i]->job, message_text(name, sizeof name, f->idle[i]->name),
                                 job_state_word(f->idle[i]->state));
    if (f->idle_count > IDLE_SHOWN)
        snprintf(more, sizeof more, ", and %zu more", f->idle_count - IDLE_SHOWN);
    return error_set(err, STATUS_ERR_NOT_FOUND, "nothing to do: %s%s", list, more);
}

/* Each that was named exists. */
static status check_found(const struct filter *f, const struct chosen_jobs *jobs, struct error *err)
{
    for (size_t i = 0; i < f->rest->count; i++) {
        const char *text = f->rest->items[i];

        if (!f->seen[i] && is_number(text))
            return error_set(err, STATUS_ERR_NOT_FOUND, "there is no job %s ('azulejo list' shows which there are)",
                             text);
        if (!f->seen[i])
            return error_set(err, STATUS_ERR_NOT_FOUND, "no job is named '%s' ('azulejo list' shows which there are)",
                             text);
    }
    if (jobs->count == 0 && f->idle_count > 0)
        return report_idle(f, err);
    if (jobs->count == 0)
        return error_set(err, STATUS_ERR_NOT_FOUND, "no job matches");
    return STATUS_OK;
}

status job_choice_find(struct connection *c, const struct job_choice *choice, const struct positionals *rest,
                       struct chosen_jobs *out, struct error *err)
{
    struct filter filter = {.rest = rest, .verb = choice->verb, .ended_before = choice->ended_before};
    status result = STATUS_OK;
    size_t kept = 0;
    int one_word = rest->count == 1 && !choice->states && !choice->mine && !choice->ended_before;

    out->several = !one_word || !is_number(rest->items[0]);
    if (!out->several) {
        add(out, strtoull(rest->items[0], NULL, 10), NULL);
        return STATUS_OK;
    }
    if (choice->mine)
        filter.owner = connection_who(c);
    if (choice->states)
        result = parse_states(choice->states, &filter.states, err);
    THEN(result, find_all(c, &filter, out, err));
    if (result != STATUS_OK)
        return result;
    if (out->count > 0)
        qsort(out->items, out->count, sizeof *out->items, compare);
    /* A job that was submitted meanwhile can be in two answers. */
    for (size_t i = 0; i < out->count; i++)
        if (kept == 0 || out->items[i].job != out->items[kept - 1].job)
            out->items[kept++] = out->items[i];
    out->count = kept;
    out->asks = !one_word || kept > 1 || wildcard_is(rest->items[0]);
    return check_found(&filter, out, err);
}

/* Several jobs fit a word that must name one. */
static status report_several(const char *text, const struct chosen_jobs *jobs, struct error *err)
{
    char list[NAMED_SHOWN * 24] = "", more[48] = "";
    size_t used = 0, hidden = jobs->count > NAMED_SHOWN ? jobs->count - NAMED_SHOWN : 0;

    for (size_t i = hidden; i < jobs->count; i++)
        used +=
            (size_t)snprintf(list + used, sizeof list - used, "%s%" PRIu64, i > hidden ? ", " : "", jobs->items[i].job);
    if (hidden)
        snprintf(more, sizeof more, " and %zu older ones", hidden);
    return error_set(err, STATUS_ERR_USAGE, "%zu jobs are named '%s': give the number of one (%s%s)", jobs->count, text,
                     list, more);
}

status job_word_find(struct connection *c, const char *text, uint64_t *job, struct error *err)
{
    const struct job_choice any = {.yes = 1};
    struct chosen_jobs jobs = {0};
    const struct positionals word = {{text}, 1};
    status result = job_choice_find(c, &any, &word, &jobs, err);

    if (result == STATUS_OK && jobs.count > 1)
        result = report_several(text, &jobs, err);
    if (result == STATUS_OK)
        *job = jobs.items[0].job;
    chosen_jobs_release(&jobs);
    return result;
}

status job_needs_find(struct connection *c, const char *after, struct job_needs *out, struct error *err)
{
    char word[NAME_MAX_BYTES + 2];
    status result = STATUS_OK;

    out->after_count = 0;
    for (const char *at = after, *end; at && result == STATUS_OK; at = *end ? end + 1 : NULL) {
        end = at + strcspn(at, ",");
        if (out->after_count == JOB_AFTER_MAX)
            return error_set(err, STATUS_ERR_USAGE, "--after: at most %d jobs", JOB_AFTER_MAX);
        snprintf(word, sizeof word, "%.*s", (int)(end - at), at);
        result = job_word_check(word, err);
        if (c)
            THEN(result, job_word_find(c, word, &out->after[out->after_count], err));
        out->after_count++;
    }
    if (result != STATUS_OK)
        error_prefix(err, "--after");
    return result;
}

void chosen_jobs_release(struct chosen_jobs *jobs)
{
    for (size_t i = 0; i < jobs->answer_count; i++)
        message_free(jobs->answers[i]);
    mem_free(jobs->answers);
    mem_free(jobs->items);
    *jobs = (struct chosen_jobs){0};
}

status job_choice_confirm(const struct job_choice *choice, const struct chosen_jobs *jobs, const char *verb, int *go_on,
                          struct error *err)
{
    char answer[16] = "", name[256];

    *go_on = 1;
    if (!jobs->asks || choice->yes)
        return STATUS_OK;
    if (!isatty(STDIN_FILENO))
        return error_set(err, STATUS_ERR_USAGE, "would %s %zu job%s, and there is no terminal to ask: give --yes", verb,
                         jobs->count, jobs->count == 1 ? "" : "s");
    fprintf(stderr, "%s %zu job%s:\n", verb, jobs->count, jobs->count == 1 ? "" : "s");
    for (size_t i = 0; i < jobs->count && i < SHOWN_MAX; i++) {
        const Azulejo__Wire__JobInfo *info = jobs->items[i].info;
        char owner[CONNECTION_WHO_MAX];
        fprintf(stderr, "  %6" PRIu64 "  %-10s  %s  %s\n", info->job, job_state_word(info->state),
                message_text(name, sizeof name, info->name), message_text(owner, sizeof owner, info->owner));
    }
    if (jobs->count > SHOWN_MAX)
        fprintf(stderr, "  and %zu more\n", jobs->count - SHOWN_MAX);
    fprintf(stderr, "go on? [y/N] ");
    fflush(stderr);
    *go_on = fgets(answer, sizeof answer, stdin) && (answer[0] == 'y' || answer[0] == 'Y');
    return STATUS_OK;
}
