// Scratch models and data, on which threads collide geoms at the same time.
//
// Collisions change options of the model while they look for nearest points, move geoms to where
// they will be, and take memory from the stack of the data. Every thread but the calling one has a
// model and data of its own for that: copies of the structs that point to the arrays of the
// originals, but for options, poses of geoms, stack and buffers of faces.

#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "dashpot/detect/collisions.hpp"
#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/model/errors.hpp"

namespace dashpot::host {

// Kept from step to step.
class Scratch {
 public:
  Scratch();
  ~Scratch();

  // Before a pass of `workers` threads over pairs of geoms, during which nothing else changes `m`
  // and `d`. `faces` as in ReplacedCollisions.
  void open(mjModel_* m, mjData_* d, FaceBuffers* faces, int workers);
  // After the pass: what the stacks took goes to the data.
  void close();

 private:
  friend class WorkerScratch;
  struct Originals;
  struct Place;
  Place& place(int worker);

  mjModel_* model_ = nullptr;
  mjData_* data_ = nullptr;
  FaceBuffers* faces_ = nullptr;
  // As they are before the pass: the calling thread works on the originals meanwhile.
  std::unique_ptr<Originals> originals_;
  std::vector<std::unique_ptr<Place>> places_;  // of the workers from 1 on
};

// That of one worker, while it lives in the worker's thread. In all threads but the calling one,
// whose own they are, collisions are replaced and errors of MuJoCo thrown.
class WorkerScratch {
 public:
  WorkerScratch(Scratch& all, int worker);

  mjModel_* model() const { return model_; }
  mjData_* data() const { return data_; }
  FaceBuffers* faces() const { return faces_; }

 private:
  mjModel_* model_;
  mjData_* data_;
  FaceBuffers* faces_;
  std::optional<ErrorGuard> errors_;
  std::optional<ReplacedCollisions> collisions_;
};

}  // namespace dashpot::host
