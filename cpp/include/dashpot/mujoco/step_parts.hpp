// A step in parts of their own time step.

#pragma once

#include <vector>

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// A step that may be taken in parts of their own time step. Where it was, the model's time step is
// restored at its end, and time has advanced by that step or, without finish(), the state at the
// start is back but for poses of mocap bodies (mocap_motion.hpp).
class StepParts {
 public:
  StepParts(mjModel_* m, mjData_* d);
  ~StepParts();
  StepParts(const StepParts&) = delete;
  StepParts& operator=(const StepParts&) = delete;

  double whole() const { return timestep_; }  // s
  bool cut() const { return !start_.empty(); }
  void set_length(double length);  // of the part, s; the first call cuts the step
  // The buffers of delayed controls and sensors have one sample of a step, that of its start.
  void end_part();
  void finish() { finished_ = true; }

 private:
  mjModel_* model_;
  mjData_* data_;
  double timestep_, end_;
  bool finished_ = false;
  std::vector<double> start_, history_;
};

}  // namespace dashpot::host
