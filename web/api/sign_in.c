#include "web/api/sign_in.h"

#include <inttypes.h>
#include <jansson.h>
#include <openssl/crypto.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "web/base/access.h"
#include "web/base/problem.h"
#include "web/web.h"

static void answer_who(struct web_request *request, const char *headers)
{
    const struct web_caller *caller = &request->caller;
    char host[64] = "";
    json_t *root;
    char *text;
    struct error err = {0};

    (void)gethostname(host, sizeof host - 1);
    root = json_pack("{s:s, s:s, s:I, s:s, s:s, s:s}", "role", web_role_name(caller->role), "who", caller->who,
                     "token", (json_int_t)caller->token, "token_name", caller->token_name, "software", "azulejo " AZULEJO_VERSION, "farm", host);
    text = root ? json_dumps(root, JSON_COMPACT) : NULL;
    if (text) {
        web_answer(request, 200, "application/json", headers, text, strlen(text));
    } else {
        error_no_memory(&err, "an answer");
        web_fail(request, &err);
    }
    free(text);
    json_decref(root);
}

void web_session_get(struct web_request *request) { answer_who(request, NULL); }

/* The token of the body into out; 0: there is none, and this was answered. */
static int take_token(struct web_request *request, char out[TOKEN_TEXT_SIZE])
{
    json_error_t why;
    json_t *root = json_loadb((const char *)request->body.data, request->body.size, 0, &why);
    const char *token = root ? json_string_value(json_object_get(root, "token")) : NULL;
    int found = token && json_object_size(root) == 1;

    if (found)
        snprintf(out, TOKEN_TEXT_SIZE, "%s", strlen(token) < TOKEN_TEXT_SIZE ? token : "");
    else
        problem_answer(request, PROBLEM_INPUT, "the body must be {\"token\": \"azt_...\"}, and nothing else");
    json_decref(root);
    return found;
}

void web_session_post(struct web_request *request)
{
    struct web *web = request->web;
    char token[TOKEN_TEXT_SIZE] = "", cookie[COOKIE_SIZE], line[sizeof cookie + 160];
    int64_t life_s, now_s = clock_wall_s();

    if (!take_token(request, token))
        return;
    if (!callers_find(&web->callers, token, now_s, &request->caller)) {
        if (access_note_failure(web, request->peer))
            problem_answer(request, PROBLEM_NO_TOKEN,
                           "this is no token, or one that has ended: the coordinator prints its own when it starts, "
                           "and 'azulejo token create' makes one");
        else
            problem_answer(request, PROBLEM_LIMIT,
                           "too many wrong tokens came from your address: try again in a minute");
        return;
    }
    callers_cookie(&web->callers, request->caller.token, now_s, cookie, &life_s);
    snprintf(line, sizeof line,
             "set-cookie: " GUARD_COOKIE "%u=%s; Path=/; Max-Age=%" PRId64 "; HttpOnly; SameSite=Strict%s\r\n",
             web->guard.port, cookie, life_s, web->guard.is_tls ? "; Secure" : "");
    access_note_use(web, request->caller.token);
    access_note_sign_in(web, request->caller.who, request->peer, request->caller.token);
    answer_who(request, line);
    OPENSSL_cleanse(token, sizeof token);
}

void web_session_delete(struct web_request *request)
{
    char line[160];

    snprintf(line, sizeof line, "set-cookie: " GUARD_COOKIE "%u=; Path=/; Max-Age=0; HttpOnly; SameSite=Strict%s\r\n",
             request->web->guard.port, request->web->guard.is_tls ? "; Secure" : "");
    web_answer(request, 204, "application/json", line, NULL, 0);
}
