/* verbs: what people can do to jobs, each once. From these rows follow the messages that the coordinator takes and its
 * checks, the paths of the API, the commands of azulejo with their help and completion, the verbs that each job carries
 * in JSON, and what the page offers.
 *
 * VERB(NAME, name, ROLE, run, says, HELP(arguments, summary, description), ...)
 *   NAME, name  message JobName of azulejo.proto and its field job_name of Envelope; the function steer_name of
 *               coordinator/farm, which does it; POST /api/v1/jobs/JOB/name; `azulejo name`
 *   ROLE        the least role of a token; for jobs of its own, "submit" suffices
 *   run         the command: verb_command, or a function of a file of its own
 *   says        what happens, for the page and the API
 * VARIANT(NAME, name, verb, says, ...)
 *   the verb's message with its argument: a button of its own on the page, with states of its own
 *
 * The rest are members of struct job_verb. A new verb needs a row, its message and its function: docs/EXTENDING.md. */
#pragma once

#include <stdint.h>

#include "common/schema/job_states.h"

#define IN(STATE) (1u << JOB_STATE_##STATE)
#define IN_WORK (IN(QUEUED) | IN(RUNNING) | IN(PAUSED) | IN(PARKED) | IN(FINISHING))
#define HAS_ENDED (IN(DONE) | IN(FAILED) | IN(CANCELLED))
#define ANY_STATE (IN_WORK | IN(CANCELLING) | HAS_ENDED)

#define JOB_VERBS(VERB, VARIANT)                                                                                       \
    VERB(PAUSE, pause, OPERATE, verb_command,                                                                          \
         "Stop rendering the job until it is resumed. The samples so far stay.",                                       \
         HELP("JOB... [OPTION]...", "stop jobs until they are resumed",                                                \
              "Stop rendering jobs. What is rendered stays, and nothing but 'azulejo resume' puts them back into the\n" \
              "queue. A JOB is a number or a name, in which * and ? may stand for anything."),                         \
         .states = IN(QUEUED) | IN(RUNNING), .accepted = IN(PAUSED), .front = IN(QUEUED) | IN(RUNNING),                \
         .past = "paused")                                                                                             \
    VERB(RESUME, resume, OPERATE, verb_command, "Put the job back into the queue.",                                    \
         HELP("JOB... [OPTION]...", "put paused and parked jobs back into the queue",                                  \
              "Put jobs back into the queue that were paused, or parked because workers died while they rendered them.\n" \
              "They go on where they were. 'azulejo show JOB' says why a job was parked."),                            \
         .states = IN(PAUSED) | IN(PARKED), .front = IN(PAUSED) | IN(PARKED),                                          \
         .past = "resumed", .done = "back in the queue")                                                               \
    VERB(FINISH, finish, OPERATE, verb_command,                                                                        \
         "End the job early with whole pictures, from the samples so far; frames not begun are left out. Retry renders the rest.", \
         HELP("JOB... [OPTION]...", "end jobs early, with whole pictures",                                             \
              "Frames in work complete their first pass, if they have not, and become pictures with the samples that\n" \
              "they have. Frames that were not begun stay undone. The jobs are then done, finished early; 'azulejo\n"  \
              "extend' and 'azulejo retry' go on with them."),                                                         \
         .states = IN(QUEUED) | IN(RUNNING) | IN(PAUSED), .accepted = IN(FINISHING), .when = VERB_WHEN_BEGUN,          \
         .front = IN(QUEUED) | IN(RUNNING), .past = "finished",                                                        \
         .done = "finishing: frames in work end with whole pictures, no frame is begun. Retry renders the rest")       \
    VERB(START, start, OPERATE, verb_command, "Let the job wait no longer for other jobs or for a time.",              \
         HELP("JOB... [OPTION]...", "let jobs begin that wait for other jobs or for a time",                           \
              "Jobs that were submitted with --after or --not-before wait for that no longer. What they --require of\n" \
              "workers remains, and a paused job stays paused."),                                                      \
         .states = IN_WORK | IN(CANCELLING), .when = VERB_WHEN_WAITING, .front = IN(QUEUED), .past = "started",        \
         .done = "waiting for nothing but its turn")                                                                   \
    VERB(PRIORITY, priority, OPERATE, verb_command,                                                                    \
         "Serve the job earlier or later. Jobs with a higher number go first.",                                        \
         HELP("JOB... --to N [OPTION]...", "serve jobs earlier or later",                                              \
              "Change the priority of jobs. Jobs with a higher number go first; what is being rendered is not stopped."), \
         .states = IN_WORK | IN(CANCELLING), .front = IN(QUEUED), .past = "given another priority",                    \
         .done = "moved in the queue", .takes = VERB_TAKES_NUMBER, .field = "priority", .option = "to",                \
         .placeholder = "N", .help = "the new priority: jobs with a higher number go first", .most = 1000000,          \
         .imperative = "change the priority of", .button = "Set the priority")                                         \
    VERB(RETRY, retry, OPERATE, verb_command, "Go on with the job's frames that are not done, from the samples they have.", \
         HELP("JOB... [OPTION]...", "go on with jobs that failed, were cancelled or were finished early",              \
              "Put jobs that have ended back into the queue. Frames that are not done, or that a person cut short, go on\n" \
              "with the films that are there, or from the beginning; with --frames these frames, whatever they have."), \
         .states = HAS_ENDED, .when = VERB_WHEN_UNFINISHED, .front = IN(FAILED) | IN(CANCELLED),                       \
         .past = "tried again", .done = "back in the queue, with the samples it has")                                  \
    VARIANT(RETRY_FRAMES, retry-frames, retry, "Render chosen frames again.", .states = HAS_ENDED,                     \
            .done = "back in the queue", .takes = VERB_TAKES_FRAMES, .field = "frames", .label = "Retry frames",       \
            .single = 1, .button = "Retry these frames")                                                               \
    VERB(EXTEND, extend, OPERATE, extend_command,                                                                      \
         "Give the job another target: more samples or a smaller error; while it is in work, also a larger one.",      \
         HELP("JOB [OPTION]...", "give a job in work, or a done one, another target",                                  \
              "Change when the frames of a job have enough samples. The new rules replace the old ones. Frames in work go on,\n" \
              "or end if they are good enough. Done frames go on from the films that the coordinator kept, if the new rules\n" \
              "want more of them; of a job that is done all go on, or some (--frames), and the rules must be stricter. The\n" \
              "pictures are those that the options would have given at once; a frame that has more samples than they want\n" \
              "keeps them."),                                                                                          \
         .states = IN(QUEUED) | IN(RUNNING) | IN(PAUSED) | IN(PARKED) | IN(DONE), .front = IN(DONE),                   \
         .past = "extended", .done = "has its new target", .takes = VERB_TAKES_FORM, .single = 1)                      \
    VERB(DEVELOP, develop, OPERATE, develop_command, "Tone map the job's pictures again, without rendering.",          \
         HELP("JOB --tonemap OPERATOR [--PARAMETER VALUE]... [OPTION]...",                                             \
              "tone map a job's pictures again, without rendering",                                                    \
              "Make the PNG and JPEG pictures of a job's finished frames again, and those of its frames to come, with\n" \
              "this tone mapping: as for a new job, what is not said is the default. Only --format, --png-bits and\n"  \
              "--jpeg-quality stay the job's unless they are given; the EXR files, or that there are none, always do."), \
         .states = ANY_STATE, .front = IN(DONE), .past = "developed", .done = "making its pictures again",             \
         .takes = VERB_TAKES_FORM, .single = 1)                                                                        \
    VERB(COMMENT, comment, OPERATE, verb_command, "Note something at the job, for those who see it; an empty text removes it.", \
         HELP("JOB... TEXT [OPTION]...", "note something at jobs",                                                     \
              "Put a comment at jobs, which 'azulejo list' and 'show', the page and JSON have until another replaces it; an\n" \
              "empty TEXT removes it."),                                                                               \
         .states = ANY_STATE, .past = "commented", .takes = VERB_TAKES_TEXT, .field = "comment",                       \
         .imperative = "comment on", .button = "Keep the comment")                                                     \
    VERB(CANCEL, cancel, OPERATE, cancel_command,                                                                      \
         "End the job. Pictures are made of what is rendered, and Retry goes on from there.",                          \
         HELP("JOB... [OPTION]...", "end jobs",                                                                        \
              "End jobs. Pictures are made of the frames in work with the samples that they hold; these and the\n"     \
              "frames that are done can be fetched. Of a single job they are waited for, up to 30 seconds."),          \
         .states = IN_WORK, .accepted = IN(CANCELLING) | HAS_ENDED,                                                    \
         .front = IN(PAUSED) | IN(PARKED) | IN(FINISHING), .past = "cancelled",                                        \
         .done = "cancelled: pictures are made of what is rendered")                                                   \
    VARIANT(DISCARD, discard, cancel, "End the job, and free the room of its unfinished frames at once.",              \
            .states = IN_WORK | IN(CANCELLING), .accepted = HAS_ENDED, .front = IN(CANCELLING), .done = "cancelled",   \
            .takes = VERB_TAKES_FLAG, .field = "discard", \
            .help = "discard the samples of unfinished frames instead of making pictures of them", .label = "Cancel and discard", \
            .question = "All samples of unfinished frames are lost: no pictures are made of them, and Retry begins them" \
                        " from nothing. Pictures of finished frames stay.", .button = "Discard the samples")           \
    VERB(REMOVE, remove, OPERATE, verb_command, "Forget the job, with its pictures.",                                  \
         HELP("JOB... [OPTION]...", "forget jobs that have ended, with their pictures",                                \
              "Remove jobs that have ended from the coordinator, with their logs, films and pictures. Files that were\n" \
              "fetched stay."),                                                                                        \
         .states = HAS_ENDED, .front = IN(FAILED) | IN(CANCELLED), .past = "removed", .removes = 1,                    \
         .remedy = "'cancel' it first",                                                                                \
         .question = "The coordinator forgets the job: its pictures, films, settings and log are lost. Nothing brings them back." \
                     " Pictures that were downloaded stay where they are.")

enum job_verb_name {
#define VERB(NAME, ...) VERB_##NAME,
    JOB_VERBS(VERB, VERB)
#undef VERB
    VERB_COUNT
};

/* FORM: several fields, which commands and page ask for in their own way. */
enum verb_takes {
    VERB_TAKES_NOTHING,
    VERB_TAKES_FLAG,
    VERB_TAKES_NUMBER,
    VERB_TAKES_TEXT,
    VERB_TAKES_FRAMES,
    VERB_TAKES_FORM
};
/* What a job must be besides its state (steer_offers). */
enum verb_when { VERB_ALWAYS, VERB_WHEN_BEGUN, VERB_WHEN_WAITING, VERB_WHEN_UNFINISHED };

struct job_verb {
    const char *name; /* "pause" */
    const char *path; /* of the API; a variant has that of its verb */
    const char *says;
    unsigned states;   /* bits of states, in which it does something */
    unsigned accepted; /* in which it is no error, and not offered */
    unsigned front;    /* in which the page shows it as a button, not in a menu */
    enum verb_when when;
    enum verb_takes takes;
    const char *field;                /* of the message that has the argument */
    const char *option, *placeholder; /* of a number: --to N; a text is the last word of the command line */
    const char *help;                 /* of its option, but of frames */
    int64_t most;                     /* of a number: -most..most at the command line */
    int single, removes;              /* for one job at a time on the page; the job is gone after it */
    const char *imperative;           /* "pause" 3 jobs; NULL: the name */
    const char *past;                 /* "paused" */
    const char *label;                /* of the page's button; NULL: the name with a capital */
    const char *done;                 /* what the page says of the job after it; NULL: the past */
    const char *question;             /* what is lost: the page asks first; NULL: nothing is */
    const char *button;               /* of what it asks; NULL: the label */
    const char *remedy;               /* where it is refused; NULL: the state's */
};
extern const struct job_verb job_verbs[VERB_COUNT];

/* By its name, which exists. */
const struct job_verb *job_verb_find(const char *name);
/* The verb's message with its argument; NULL: it has no variant. */
const struct job_verb *job_verb_variant(const struct job_verb *verb);
