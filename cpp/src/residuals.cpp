#include "dashpot/residuals.hpp"

#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <stdexcept>

#include "dashpot/parallel.hpp"

namespace dashpot {
namespace {

// log(R_o^T R) from the quaternions of R_o and R, the shorter way round.
std::array<double, 3> rotation_difference(const double* observed, const double* simulated) {
  const double a0 = observed[0], a1 = -observed[1], a2 = -observed[2], a3 = -observed[3];
  const double b0 = simulated[0], b1 = simulated[1], b2 = simulated[2], b3 = simulated[3];
  double w = a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3;
  std::array<double, 3> v = {a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
                             a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
                             a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0};
  const double sign = w < 0.0 ? -1.0 : 1.0;
  const double sine = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  const double scale = sine > 0.0 ? 2.0 * std::atan2(sine, sign * w) / sine : 2.0;
  for (double& component : v) component *= sign * scale;
  return v;
}

[[noreturn]] void fail(const ObservedTrajectory& trajectory, const std::string& what) {
  throw std::invalid_argument("trajectory '" + trajectory.name + "': " + what);
}

// Called with the pose of every observed frame and body in order.
using PoseSink =
    std::function<void(std::size_t index, const double* position, const double* quaternion)>;

void simulate(Simulation& simulation, const ObservedTrajectory& trajectory, int nu,
              const double* qpos, const double* qvel, const PoseSink& sink) {
  simulation.set_timestep(trajectory.timestep);
  simulation.reset();
  simulation.set_position_velocity(qpos, qvel);
  int step = 0;
  std::size_t index = 0;
  for (const int frame_step : trajectory.frame_step) {
    for (; step < frame_step; ++step) {
      if (!trajectory.control.empty()) {
        simulation.set_control(trajectory.control.data() + std::size_t(step) * nu);
      }
      try {
        simulation.step();
      } catch (const std::exception& error) {
        throw std::invalid_argument("step " + std::to_string(step) + ": " + error.what());
      }
    }
    simulation.update_kinematics();
    for (const int body : trajectory.body) {
      std::array<double, 3> position;
      std::array<double, 4> quaternion;
      simulation.body_pose(body, position.data(), quaternion.data());
      sink(index++, position.data(), quaternion.data());
    }
  }
}

// Runs every (variant, trajectory); sink(variant, trajectory, index, position, quaternion).
using BatchSink = std::function<void(int variant, int trajectory, std::size_t index,
                                     const double* position, const double* quaternion)>;

void simulate_all(const std::vector<Variant>& variants,
                  const std::vector<ObservedTrajectory>& trajectories, const double* qpos,
                  const double* qvel, int nthread, const BatchSink& sink) {
  if (variants.empty() || trajectories.empty()) return;
  const ModelSizes sizes = sizes_of(variants.front().model);
  for (const Variant& variant : variants) {
    const ModelSizes other = sizes_of(variant.model);
    if (other.nq != sizes.nq || other.nv != sizes.nv || other.nu != sizes.nu ||
        other.nbody != sizes.nbody) {
      throw std::invalid_argument("the variants' models differ in nq, nv, nu or nbody");
    }
  }
  for (const ObservedTrajectory& trajectory : trajectories) check(trajectory, sizes);

  const int ntrajectory = static_cast<int>(trajectories.size());
  const int items = static_cast<int>(variants.size()) * ntrajectory;
  const int threads = thread_count(nthread, items);
  struct Worker {
    int variant = -1;
    std::unique_ptr<Simulation> simulation;
  };
  std::vector<Worker> workers(threads);

  parallel_for(items, threads, [&](int worker_id, int item) {
    const int variant = item / ntrajectory;
    const int t = item % ntrajectory;
    const ObservedTrajectory& trajectory = trajectories[t];
    Worker& worker = workers[worker_id];
    try {
      if (worker.variant != variant) {
        worker.simulation =
            std::make_unique<Simulation>(variants[variant].model, variants[variant].parameters);
        worker.variant = variant;
      }
      simulate(*worker.simulation, trajectory, sizes.nu, qpos + std::size_t(item) * sizes.nq,
               qvel + std::size_t(item) * sizes.nv,
               [&](std::size_t index, const double* position, const double* quaternion) {
                 sink(variant, t, index, position, quaternion);
               });
    } catch (const std::exception& error) {
      fail(trajectory, "variant " + std::to_string(variant) + ", " + error.what());
    }
  });
}

// Offset of each trajectory's first pose among those of all.
std::vector<std::size_t> pose_offsets(const std::vector<ObservedTrajectory>& trajectories) {
  std::vector<std::size_t> offsets = {0};
  for (const ObservedTrajectory& trajectory : trajectories) {
    offsets.push_back(offsets.back() + std::size_t(trajectory.frames()) * trajectory.bodies());
  }
  return offsets;
}

}  // namespace

void check(const ObservedTrajectory& trajectory, const ModelSizes& sizes) {
  const std::size_t poses = std::size_t(trajectory.frames()) * trajectory.bodies();
  if (poses == 0) fail(trajectory, "has no frame or no body");
  if (!(trajectory.timestep > 0.0)) fail(trajectory, "timestep must be > 0");
  for (const double weight : trajectory.position_weight) {
    if (!(weight >= 0.0 && std::isfinite(weight))) {
      fail(trajectory, "position_weight must be finite and >= 0");
    }
  }
  if (!(trajectory.rotation_weight >= 0.0 && std::isfinite(trajectory.rotation_weight))) {
    fail(trajectory, "rotation_weight must be finite and >= 0");
  }
  for (std::size_t i = 0; i < trajectory.frame_step.size(); ++i) {
    if (trajectory.frame_step[i] < (i == 0 ? 0 : trajectory.frame_step[i - 1] + 1)) {
      fail(trajectory,
           "frame_step must be >= 0 and ascend; it does not at index " + std::to_string(i));
    }
  }
  for (const int body : trajectory.body) {
    if (body < 0 || body >= sizes.nbody) {
      fail(trajectory, "body " + std::to_string(body) + " is not in the model");
    }
  }
  if (trajectory.position.size() != 3 * poses) fail(trajectory, "position has the wrong size");
  if (trajectory.quaternion.size() != 4 * poses) fail(trajectory, "quaternion has the wrong size");
  if (!trajectory.control.empty() &&
      trajectory.control.size() < std::size_t(trajectory.frame_step.back()) * sizes.nu) {
    fail(trajectory, "control has fewer rows than the simulation has steps");
  }
}

std::size_t residual_count(const std::vector<ObservedTrajectory>& trajectories) {
  return 6 * pose_offsets(trajectories).back();
}

void residuals(const std::vector<Variant>& variants,
               const std::vector<ObservedTrajectory>& trajectories, const double* qpos,
               const double* qvel, int nthread, double* residuals) {
  const std::vector<std::size_t> offsets = pose_offsets(trajectories);
  simulate_all(
      variants, trajectories, qpos, qvel, nthread,
      [&](int variant, int t, std::size_t index, const double* position, const double* quaternion) {
        const ObservedTrajectory& trajectory = trajectories[t];
        double* row = residuals + 6 * (variant * offsets.back() + offsets[t] + index);
        const double* observed = trajectory.position.data() + 3 * index;
        const std::array<double, 3> rotation =
            rotation_difference(trajectory.quaternion.data() + 4 * index, quaternion);
        for (int i = 0; i < 3; ++i) {
          row[i] = (position[i] - observed[i]) * trajectory.position_weight[i];
          row[3 + i] = rotation[i] * trajectory.rotation_weight;
        }
      });
}

void poses(const std::vector<Variant>& variants,
           const std::vector<ObservedTrajectory>& trajectories, const double* qpos,
           const double* qvel, int nthread, double* poses) {
  const std::vector<std::size_t> offsets = pose_offsets(trajectories);
  simulate_all(
      variants, trajectories, qpos, qvel, nthread,
      [&](int variant, int t, std::size_t index, const double* position, const double* quaternion) {
        double* row = poses + 7 * (variant * offsets.back() + offsets[t] + index);
        for (int i = 0; i < 3; ++i) row[i] = position[i];
        for (int i = 0; i < 4; ++i) row[3 + i] = quaternion[i];
      });
}

}  // namespace dashpot
