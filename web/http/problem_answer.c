#include "web/base/problem.h"

void problem_answer(struct web_request *request, enum problem problem, const char *detail)
{
    const char *headers = problem == PROBLEM_NO_TOKEN ? "www-authenticate: Bearer realm=\"azulejo\"\r\n" : NULL;
    struct buffer text = BUFFER_INIT;

    problem_put(&text, problem, detail, request->path);
    web_answer(request, problem_kinds[problem].http_status, PROBLEM_CONTENT_TYPE, headers, text.data, text.size);
    buffer_release(&text);
}

void problem_answer_lost(struct web_request *request, const struct error *why)
{
    int is_token = why->code == STATUS_ERR_REFUSED && request->caller.token;

    problem_answer(request, is_token ? PROBLEM_NO_TOKEN : PROBLEM_UNAVAILABLE,
                   why->code == STATUS_OK ? "the coordinator is ending; try again in a moment" : why->text);
}

void problem_list(struct web_request *request)
{
    struct buffer text = BUFFER_INIT;

    buffer_puts(&text, "The problems that the API answers with. 'code' is one of these; 'detail' says more.\n");
    for (int i = 0; i < PROBLEM_COUNT; i++)
        buffer_printf(&text, "\n%s (%u): %s.\n    %s\n", problem_kinds[i].code, problem_kinds[i].http_status,
                      problem_kinds[i].title, problem_kinds[i].meaning);
    web_answer(request, 200, "text/plain; charset=utf-8", NULL, text.data, text.size);
    buffer_release(&text);
}

void web_fail(struct web_request *request, const struct error *why)
{
    problem_answer(request, problem_of_request(why->code, request->caller.role != WEB_ROLE_NONE), why->text);
}
