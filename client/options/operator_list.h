/* operator_list: the tone mapping operators with their parameters, for people and programs. */
#pragma once

#include "common/cli/options.h"
#include "common/base/status.h"

/* To standard output. `rows`: the command's own options, whose names parameters cannot have. */
status operator_list_print(const struct option *rows, int json, struct error *err) MUST_CHECK;
