// Models of the tests that step, with memory for contacts.

#pragma once

#include <mujoco/mujoco.h>

#include <cstdio>
#include <cstdlib>
#include <string>

#include "dashpot/model/state.hpp"
#include "dashpot/step/contacts.hpp"

// The model of an MJCF text, to be deleted by the caller. Ends the program where it has errors.
inline mjModel* compile(const std::string& xml, int contact_capacity) {
  char error[500] = "";
  mjSpec* spec = mj_parseXMLString(xml.c_str(), nullptr, error, sizeof error);
  mjModel* m = spec ? mj_compile(spec, nullptr) : nullptr;
  if (!m) {
    std::printf("scene: %s\n", spec ? mjs_getError(spec) : error);
    std::exit(EXIT_FAILURE);
  }
  mj_deleteSpec(spec);
  dashpot::host::reserve_memory(m, dashpot::memory_layout(m, contact_capacity).size());
  return m;
}
