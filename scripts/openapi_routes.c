/* openapi_routes: the page's table of routes, of problems and of fields that are words, as JSON, for scripts/openapi.py.
 *
 * It runs while azulejo-web is built, and links all of it but the page's files, of which openapi.yaml is one.
 * Messages are named by their field of the Envelope and by their type. */
#include <jansson.h>
#include <stdio.h>

#include "common/schema/choices.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/json/json_wire_parts.h"
#include "web/api/assets.h"
#include "web/base/problem.h"
#include "web/api/routes.h"

const struct web_asset_file web_asset_files[] = {{0, 0, 0, 0, 0, 0, 0}};
const size_t web_asset_file_count = 0;

static const char *const methods[] = {[WEB_GET] = "get", [WEB_POST] = "post", [WEB_PUT] = "put", [WEB_DELETE] = "delete"};

/* {"field": "job_pause", "type": "JobPause"}; null: none. */
static json_t *message(int body)
{
    const ProtobufCFieldDescriptor *field =
        protobuf_c_message_descriptor_get_field(&azulejo__wire__envelope__descriptor, (unsigned)body);
    const ProtobufCMessageDescriptor *type = field ? field->descriptor : NULL;

    return type ? json_pack("{s:s, s:s}", "field", field->name, "type", type->short_name) : json_null();
}

static json_t *route(const struct web_route *r)
{
    return json_pack("{s:s, s:s, s:s, s:b, s:o, s:o, s:b, s:b, s:b, s:s, s:s, s:s}", "method", methods[r->method],
                     "path", r->path, "role", web_role_name(r->role), "own", r->own_jobs_suffice, "message",
                     message(r->message), "answer", message(r->answer), "run", r->run != NULL, "open", r->open != NULL,
                     "streams", r->streams_body, "query", r->query ? r->query : "", "fixed", r->fixed ? r->fixed : "",
                     "summary", r->summary);
}

static void add_choice(json_t *list, const ProtobufCMessageDescriptor *type, const char *field, const struct setting *row)
{
    json_t *words = json_array();
    const char *word;

    for (uint64_t i = 0; (word = choice_word(row->choice, i)); i++)
        json_array_append_new(words, json_string(word));
    json_array_append_new(list, json_pack("{s:s, s:s, s:b, s:o}", "message", type->short_name, "field", field, "set",
                                          row->kind == SETTING_KIND_SET, "words", words));
}

/* Append the fields of this message, and of those in it, that are words in JSON. `seen`: the messages so far. */
static void add_choices(json_t *list, const ProtobufCMessageDescriptor *type, json_t *seen)
{
    if (json_object_get(seen, type->name))
        return;
    json_object_set_new(seen, type->name, json_true());
    for (unsigned i = 0; i < type->n_fields; i++) {
        const ProtobufCFieldDescriptor *field = &type->fields[i];
        const struct setting *row = json_wire_choice(type, field);
        if (row)
            add_choice(list, type, field->name, row);
        if (field->type == PROTOBUF_C_TYPE_MESSAGE)
            add_choices(list, field->descriptor, seen);
    }
}

int main(void)
{
    json_t *routes = json_array(), *problems = json_array(), *choices = json_array(), *seen = json_object(), *all;
    int failed;

    for (size_t i = 0; i < web_routing.count; i++)
        json_array_append_new(routes, route(&web_routing.routes[i]));
    for (int i = 0; i < PROBLEM_COUNT; i++)
        json_array_append_new(problems, json_pack("{s:s, s:i, s:s}", "code", problem_kinds[i].code, "status",
                                                  (int)problem_kinds[i].http_status, "title", problem_kinds[i].title));
    add_choices(choices, &azulejo__wire__envelope__descriptor, seen);
    all = json_pack("{s:o, s:o, s:o}", "routes", routes, "problems", problems, "choices", choices);
    failed = !all || json_dumpf(all, stdout, JSON_COMPACT) != 0 || fflush(stdout) != 0;
    json_decref(seen);
    json_decref(all);
    return failed;
}
