#include "worker/job_lines.h"

#include <pthread.h>
#include <stdio.h>

#include "common/system/log.h"
#include "protocol/message.h"

enum { LINE_SIZE = 256 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static uint64_t current; /* job */
static struct line {
    uint64_t job;
    enum log_level level;
    char text[LINE_SIZE];
} ring[JOB_LINES_MAX];
static unsigned first, count;

static void take(enum log_level level, const char *text)
{
    pthread_mutex_lock(&lock);
    if (level <= LOG_LEVEL_INFO) {
        struct line *line;
        if (count == JOB_LINES_MAX) {
            first = (first + 1) % JOB_LINES_MAX;
            count--;
        }
        line = &ring[(first + count++) % JOB_LINES_MAX];
        line->job = current;
        line->level = level;
        snprintf(line->text, sizeof line->text, "%s", text);
    }
    pthread_mutex_unlock(&lock);
}

void job_lines_of(uint64_t job)
{
    pthread_mutex_lock(&lock);
    current = job;
    pthread_mutex_unlock(&lock);
    log_tap(take);
}

/* The oldest line, taken out of the ring; 0: there is none. */
static int next_line(struct line *out)
{
    int there;

    pthread_mutex_lock(&lock);
    there = count > 0;
    if (there) {
        *out = ring[first];
        first = (first + 1) % JOB_LINES_MAX;
        count--;
    }
    pthread_mutex_unlock(&lock);
    return there;
}

void job_lines_send(struct channel *channel)
{
    struct line line;

    for (int i = 0; i < JOB_LINES_AT_ONCE && next_line(&line); i++) {
        Azulejo__Wire__Notice notice = AZULEJO__WIRE__NOTICE__INIT;
        Azulejo__Wire__Envelope e = MESSAGE(NOTICE, notice, &notice);
        char clean[LINE_SIZE];

        notice.level = (uint32_t)line.level;
        notice.job = line.job;
        notice.own = 1;
        notice.text = (char *)message_text(clean, sizeof clean, line.text);
        if (channel_send(channel, &e) != STATUS_OK)
            return; /* the line is lost with the connection */
    }
}
