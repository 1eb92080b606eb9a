/* help_groups: in which groups --help shows the options of a command that has many. */
#pragma once

void help_groups_use(void);
