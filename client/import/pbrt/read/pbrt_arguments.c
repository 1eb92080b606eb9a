/* The arguments of directives. */
#include "client/import/pbrt/read/pbrt_directive.h"

#include "client/terminal/must.h"
char *pbrt_keep(struct pbrt *p, const char *text) { return must(arena_strdup(&p->arena, text)); }

status pbrt_next_string(struct pbrt *p, const char *directive, const char **out)
{
    struct pbrt_token t;

    TRY(pbrt_next(&p->reader, &t, p->err));
    if (t.kind == TOKEN_OPEN) { /* ["name"] is tolerated, as pbrt does for values */
        TRY(pbrt_next_string(p, directive, out));
        TRY(pbrt_next(&p->reader, &t, p->err));
        if (t.kind != TOKEN_CLOSE)
            return pbrt_fail(p, STATUS_ERR_INPUT, &t.at, "a closing bracket is missing");
        return STATUS_OK;
    }
    if (t.kind != TOKEN_STRING)
        return pbrt_fail(p, STATUS_ERR_INPUT, &t.at, "%s takes a name in quotes here", directive);
    *out = pbrt_keep(p, t.text);
    return STATUS_OK;
}

status pbrt_next_numbers(struct pbrt *p, const char *directive, double *out, size_t count)
{
    struct pbrt_token t;
    int bracket;

    TRY(pbrt_peek(&p->reader, &t, p->err));
    bracket = t.kind == TOKEN_OPEN;
    if (bracket)
        TRY(pbrt_next(&p->reader, &t, p->err));
    for (size_t i = 0; i < count; i++) {
        TRY(pbrt_next(&p->reader, &t, p->err));
        if (t.kind != TOKEN_WORD || !pbrt_number(t.text, &out[i]))
            return pbrt_fail(p, STATUS_ERR_INPUT, &t.at, "%s takes %zu numbers", directive, count);
    }
    if (bracket) {
        TRY(pbrt_next(&p->reader, &t, p->err));
        if (t.kind != TOKEN_CLOSE)
            return pbrt_fail(p, STATUS_ERR_INPUT, &t.at, "%s takes %zu numbers", directive, count);
    }
    return STATUS_OK;
}

status pbrt_next_params(struct pbrt *p, struct pbrt_params *defaults)
{
    TRY(pbrt_params_read(&p->params, &p->reader, p->b));
    p->params.defaults = defaults;
    p->params.color_space = p->now.color_space;
    return STATUS_OK;
}

status pbrt_read_directive(struct pbrt *p, const char *word, struct pbrt_params *defaults, const struct pbrt_place *at,
                           struct pbrt_directive *out)
{
    *out = (struct pbrt_directive){.at = *at, .ctm = p->now.ctm, .params = &p->params};
    TRY(pbrt_next_string(p, word, &out->kind));
    return pbrt_next_params(p, defaults);
}
