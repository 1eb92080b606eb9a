#include "common/schema/job_needs.h"

#define ROW(o, ...) SETTING_ROW(job_needs, __VA_ARGS__)
const struct setting job_needs_rows[NEED_COUNT] = {JOB_NEEDS(OPTION_ROW, ROW, )};
