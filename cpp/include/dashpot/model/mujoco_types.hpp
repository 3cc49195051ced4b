// MuJoCo's structs by name, for headers that do not include its own.

#pragma once

struct mjModel_;
struct mjData_;
struct mjContact_;
struct mjPreContact_;
struct mjLogMessage_;
