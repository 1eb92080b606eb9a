#include "worker/render/base/health_scope.h"

_Thread_local struct health_scope health_scope;

void health_note(enum health_kind kind)
{
    if (!health_scope.count)
        return;
    health_scope.count[kind]++;
    health_scope.noted |= 1u << kind;
}

void health_value(struct vec3 value, real pdf)
{
    health_throughput(value);
    health_density(pdf);
}
