#include "dashpot/detect/scratch.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cstddef>
#include <cstring>

namespace dashpot::host {

namespace {

// The statistics of MuJoCo's solvers are nearly all of the struct, and nothing reads them here.
void copy_without_solver(const mjData& from, mjData& to) {
  const auto copy = [&](std::size_t begin, std::size_t end) {
    std::memcpy(reinterpret_cast<std::byte*>(&to) + begin,
                reinterpret_cast<const std::byte*>(&from) + begin, end - begin);
  };
  copy(0, offsetof(mjData, solver));
  copy(offsetof(mjData, solver_niter), sizeof(mjData));
}

}  // namespace

struct Scratch::Originals {
  mjModel model;
  mjData data;
  std::vector<mjtNum> position, rotation;  // of geoms

  void copy(const mjModel& m, const mjData& d) {
    model = m;
    copy_without_solver(d, data);
    position.assign(d.geom_xpos, d.geom_xpos + 3 * m.ngeom);
    rotation.assign(d.geom_xmat, d.geom_xmat + 9 * m.ngeom);
  }
};

struct Scratch::Place {
  bool is_open = false;  // for the present pass
  mjModel model;
  mjData data;
  FaceBuffers faces;
  std::vector<mjtNum> position, rotation;  // of geoms
  std::unique_ptr<std::byte[]> stack;
  mjtSize stack_size = 0;

  void open(const Originals& originals) {
    model = originals.model;
    copy_without_solver(originals.data, data);
    position = originals.position;
    rotation = originals.rotation;
    data.geom_xpos = position.data();
    data.geom_xmat = rotation.data();
    if (stack_size != data.narena) {
      stack.reset(new std::byte[data.narena]);
      stack_size = data.narena;
    }
    data.arena = stack.get();
    data.pbase = 0;
    is_open = true;
  }
};

Scratch::Scratch() = default;
Scratch::~Scratch() = default;

void Scratch::open(mjModel_* m, mjData_* d, FaceBuffers* faces, int workers) {
  model_ = m;
  data_ = d;
  faces_ = faces;
  while (static_cast<int>(places_.size()) < workers - 1)
    places_.push_back(std::make_unique<Place>());
  for (const auto& place : places_) place->is_open = false;
  if (workers == 1) return;
  if (!originals_) originals_ = std::make_unique<Originals>();
  originals_->copy(*m, *d);
}

Scratch::Place& Scratch::place(int worker) {
  Place& place = *places_[worker - 1];
  if (!place.is_open) place.open(*originals_);
  if (faces_) place.faces.hulls = faces_->hulls;
  return place;
}

void Scratch::close() {
  for (const auto& place : places_) {
    if (!place->is_open) continue;
    place->is_open = false;
    data_->maxuse_stack = std::max(data_->maxuse_stack, place->data.maxuse_stack);
    data_->maxuse_arena = std::max(data_->maxuse_arena, place->data.maxuse_arena);
  }
}

WorkerScratch::WorkerScratch(Scratch& all, int worker)
    : model_(all.model_), data_(all.data_), faces_(all.faces_) {
  if (worker == 0) return;
  Scratch::Place& place = all.place(worker);
  model_ = &place.model;
  data_ = &place.data;
  if (faces_) faces_ = &place.faces;
  errors_.emplace(data_);
  collisions_.emplace(model_, faces_, nullptr);
}

}  // namespace dashpot::host
