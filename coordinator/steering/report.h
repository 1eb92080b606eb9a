/* report: the farm's reports about its jobs and workers. */
#pragma once

#include "common/scene/effects.h"
#include "common/schema/verbs.h"
#include "coordinator/farm/farm.h"
#include "coordinator/pictures/measure.h"
#include "coordinator/job/wire.h"
#include "protocol/message.h"
#include "protocol/azulejo.pb-c.h"

enum {
    REPORT_CUT_FRAMES_MAX = 8,   /* more than FRAMES_OPEN_PER_JOB, which are cut at most */
    REPORT_FORECASTS_MAX = 3,
};

/* One job's message and the data that it points at; must not move once made. */
struct job_report {
    Azulejo__Wire__JobInfo message;
    Azulejo__Wire__RenderSettings settings;
    Azulejo__Wire__RenderStats stats;
    uint32_t accounts[EFFECT_ACCOUNTS];
    struct wire_work work;
    Azulejo__Wire__EndedByDepth depth;
    struct wire_output output;
    struct wire_point now;
    Azulejo__Wire__Forecast forecasts[REPORT_FORECASTS_MAX];
    Azulejo__Wire__Forecast *forecast_pointers[REPORT_FORECASTS_MAX];
    char transform[MEASURE_TEXT_MAX];
    char state_text[JOB_TEXT_MAX + 1];
    char *verbs[VERB_COUNT];
    Azulejo__Wire__StopRules stop;
    Azulejo__Wire__CutFrame cuts[REPORT_CUT_FRAMES_MAX];
    Azulejo__Wire__CutFrame *cut_pointers[REPORT_CUT_FRAMES_MAX];
};
void job_report_make(struct job_report *report, struct farm *farm, struct job *job, uint64_t now_ns);
