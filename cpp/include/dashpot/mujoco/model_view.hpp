// A model for one worker, without a copy of all that it holds.
//
// A step changes options and detection distances of its model for a while (mujoco/step_parts.hpp,
// detection/reach.hpp). A view has these of its own and shares the rest, meshes above all, which no
// step writes to: views of one model step side by side.

#pragma once

#include <memory>
#include <vector>

struct mjModel_;

namespace dashpot::host {

class ModelView {
 public:
  // Of the model as it is now; `model` must outlive the view, and what is shared must not change
  // meanwhile.
  explicit ModelView(const mjModel_* model);
  ModelView(ModelView&&) noexcept;
  ~ModelView();
  // Takes the values that the model, or another of its sizes, has now; get() stays.
  void update(const mjModel_* model);
  mjModel_* get() const { return view_.get(); }

 private:
  std::unique_ptr<mjModel_> view_;
  std::vector<double> own_;
};

}  // namespace dashpot::host
