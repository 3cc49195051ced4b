// A copy of what edits may change of a model, so that a step checks it only after an edit.

#pragma once

#include <vector>

struct mjModel_;

namespace dashpot::host {

// All options and arrays but those of meshes, textures, height fields, bounding volumes and names.
class KeptModel {
 public:
  // Whether `m` has every bit that it had when it was kept; false before.
  bool is_same(const mjModel_* m) const;
  void keep(const mjModel_* m);

 private:
  std::vector<char> copy_;
};

}  // namespace dashpot::host
