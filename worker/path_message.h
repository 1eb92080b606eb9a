/* path_message: a recorded path as a message, with the names that its scene gives. */
#pragma once

#include "common/scene/scene.h"
#include "protocol/azulejo.pb-c.h"
#include "worker/render/record.h"

struct path_message;

/* `scene` NULL: names are missing. The texts are the scene's, so it must outlive the message. NULL: out of
 * memory. Free with mem_free. */
struct path_message *path_message_new(const struct sample_record *record, const struct scene *scene);
Azulejo__Wire__SamplePath *path_message_body(struct path_message *m);
