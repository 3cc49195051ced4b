#include "dashpot/simulations/residuals.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <stdexcept>

#include "dashpot/threads/parallel.hpp"

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

// What is simulated of one frame.
struct Frame {
  explicit Frame(const ObservedTrajectory& trajectory)
      : poses(7 * trajectory.body.size()), readings(trajectory.channel.size()) {}

  std::vector<double> poses;     // (bodies, 7)
  std::vector<double> readings;  // (channels,)
};

using FrameSink = std::function<void(std::size_t frame, const Frame& simulated)>;

// Means of channels over the last steps before a frame, and the frame's own values of the others.
class Readings {
 public:
  explicit Readings(const ObservedTrajectory& trajectory)
      : trajectory_(trajectory), sum_(trajectory.channel.size()) {
    for (const ObservedChannel& channel : trajectory.channel) {
      (channel.mean ? any_mean_ : any_at_frame_) = true;
    }
  }

  // After a step, of which `left` come before the next frame.
  void add(const Simulation& simulation, int left) {
    if (!any_mean_ || left >= trajectory_.interval) return;
    const double* values = simulation.sensordata();
    for (std::size_t i = 0; i < sum_.size(); ++i) sum_[i] += values[trajectory_.channel[i].address];
    ++count_;
  }

  void read(Simulation& simulation, std::vector<double>& readings) {
    if (any_at_frame_) simulation.update_sensors();
    const double* values = simulation.sensordata();
    for (std::size_t i = 0; i < sum_.size(); ++i) {
      const ObservedChannel& channel = trajectory_.channel[i];
      readings[i] = channel.mean ? sum_[i] / std::max(count_, 1) : values[channel.address];
    }
    std::fill(sum_.begin(), sum_.end(), 0.0);
    count_ = 0;
  }

 private:
  const ObservedTrajectory& trajectory_;
  std::vector<double> sum_;
  int count_ = 0;
  bool any_mean_ = false, any_at_frame_ = false;
};

void simulate(Simulation& simulation, const ObservedTrajectory& trajectory, int nu,
              const double* qpos, const double* qvel, const Worker& worker, const FrameSink& sink) {
  simulation.set_timestep(trajectory.timestep);
  simulation.reset();
  simulation.set_position_velocity(qpos, qvel);
  int step = 0;
  Frame simulated(trajectory);
  Readings readings(trajectory);
  for (std::size_t frame = 0; frame < trajectory.frame_step.size(); ++frame) {
    const int frame_step = trajectory.frame_step[frame];
    for (; step < frame_step; ++step) {
      worker.look();
      if (!trajectory.control.empty()) {
        simulation.set_control(trajectory.control.data() + std::size_t(step) * nu);
      }
      try {
        simulation.step();
      } catch (const std::exception& error) {
        throw std::invalid_argument("step " + std::to_string(step) + ": " + error.what());
      }
      readings.add(simulation, frame_step - 1 - step);
    }
    simulation.update_kinematics();
    for (std::size_t i = 0; i < trajectory.body.size(); ++i) {
      double* pose = simulated.poses.data() + 7 * i;
      simulation.body_pose(trajectory.body[i], pose, pose + 3);
    }
    readings.read(simulation, simulated.readings);
    sink(frame, simulated);
  }
}

// Runs every (variant, trajectory).
using BatchSink =
    std::function<void(int variant, int trajectory, std::size_t frame, const Frame& simulated)>;

void simulate_all(const std::vector<Variant>& variants,
                  const std::vector<ObservedTrajectory>& trajectories, const double* qpos,
                  const double* qvel, int nthread, const Interrupt& interrupt,
                  const BatchSink& sink) {
  if (variants.empty() || trajectories.empty()) return;
  const ModelSizes sizes = sizes_of(variants.front().model);
  for (const Variant& variant : variants) {
    const ModelSizes other = sizes_of(variant.model);
    if (other.nq != sizes.nq || other.nv != sizes.nv || other.nu != sizes.nu ||
        other.nbody != sizes.nbody || other.nsensordata != sizes.nsensordata) {
      throw std::invalid_argument("the variants' models differ in nq, nv, nu, nbody or sensors");
    }
  }
  for (const ObservedTrajectory& trajectory : trajectories) check(trajectory, sizes);

  const int ntrajectory = static_cast<int>(trajectories.size());
  const int items = static_cast<int>(variants.size()) * ntrajectory;
  const int threads = thread_count(nthread, items);
  struct Own {
    int variant = -1;
    std::unique_ptr<Simulation> simulation;
  };
  std::vector<Own> of_worker(threads);

  parallel_for(items, threads, interrupt, [&](const Worker& worker, int item) {
    const int variant = item / ntrajectory;
    const int t = item % ntrajectory;
    const ObservedTrajectory& trajectory = trajectories[t];
    Own& own = of_worker[worker.index()];
    try {
      if (own.variant != variant) {
        own.simulation =
            std::make_unique<Simulation>(variants[variant].model, variants[variant].parameters);
        own.variant = variant;
      }
      simulate(
          *own.simulation, trajectory, sizes.nu, qpos + std::size_t(item) * sizes.nq,
          qvel + std::size_t(item) * sizes.nv, worker,
          [&](std::size_t frame, const Frame& simulated) { sink(variant, t, frame, simulated); });
    } catch (const std::exception& error) {
      fail(trajectory, "variant " + std::to_string(variant) + ", " + error.what());
    }
  });
}

// Offset of each trajectory's first number among those of all, of which it has `count`.
std::vector<std::size_t> offsets_of(const std::vector<ObservedTrajectory>& trajectories,
                                    int (ObservedTrajectory::*count)() const) {
  std::vector<std::size_t> offsets = {0};
  for (const ObservedTrajectory& trajectory : trajectories) {
    offsets.push_back(offsets.back() + std::size_t((trajectory.*count)()));
  }
  return offsets;
}

}  // namespace

void check(const ObservedTrajectory& trajectory, const ModelSizes& sizes) {
  const std::size_t poses = std::size_t(trajectory.poses());
  if (trajectory.residuals() == 0) fail(trajectory, "has no frame, or neither body nor sensor");
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
  if (trajectory.interval < 1) fail(trajectory, "interval must be >= 1");
  for (const ObservedChannel& channel : trajectory.channel) {
    if (channel.address < 0 || channel.address >= sizes.nsensordata) {
      fail(trajectory, "channel " + std::to_string(channel.address) + " is not in sensordata");
    }
    if (!(channel.weight >= 0.0 && std::isfinite(channel.weight))) {
      fail(trajectory, "weights of channels must be finite and >= 0");
    }
  }
  if (trajectory.reading.size() != std::size_t(trajectory.readings())) {
    fail(trajectory, "reading has the wrong size");
  }
  if (trajectory.position.size() != 3 * poses) fail(trajectory, "position has the wrong size");
  if (trajectory.quaternion.size() != 4 * poses) fail(trajectory, "quaternion has the wrong size");
  if (!trajectory.control.empty() &&
      trajectory.control.size() < std::size_t(trajectory.frame_step.back()) * sizes.nu) {
    fail(trajectory, "control has fewer rows than the simulation has steps");
  }
}

std::size_t residual_count(const std::vector<ObservedTrajectory>& trajectories) {
  return offsets_of(trajectories, &ObservedTrajectory::residuals).back();
}

std::size_t observation_count(const std::vector<ObservedTrajectory>& trajectories) {
  return offsets_of(trajectories, &ObservedTrajectory::observations).back();
}

void residuals(const std::vector<Variant>& variants,
               const std::vector<ObservedTrajectory>& trajectories, const double* qpos,
               const double* qvel, int nthread, double* residuals, const Interrupt& interrupt) {
  const std::vector<std::size_t> offsets = offsets_of(trajectories, &ObservedTrajectory::residuals);
  simulate_all(variants, trajectories, qpos, qvel, nthread, interrupt,
               [&](int variant, int t, std::size_t frame, const Frame& simulated) {
                 const ObservedTrajectory& trajectory = trajectories[t];
                 double* of_trajectory = residuals + variant * offsets.back() + offsets[t];
                 const std::size_t bodies = trajectory.body.size();
                 for (std::size_t i = 0; i < bodies; ++i) {
                   const std::size_t index = frame * bodies + i;
                   double* row = of_trajectory + 6 * index;
                   const double* pose = simulated.poses.data() + 7 * i;
                   const double* observed = trajectory.position.data() + 3 * index;
                   const std::array<double, 3> rotation =
                       rotation_difference(trajectory.quaternion.data() + 4 * index, pose + 3);
                   for (int j = 0; j < 3; ++j) {
                     row[j] = (pose[j] - observed[j]) * trajectory.position_weight[j];
                     row[3 + j] = rotation[j] * trajectory.rotation_weight;
                   }
                 }
                 const std::size_t channels = trajectory.channel.size();
                 double* row = of_trajectory + 6 * trajectory.poses() + frame * channels;
                 const double* observed = trajectory.reading.data() + frame * channels;
                 for (std::size_t i = 0; i < channels; ++i) {
                   row[i] = (simulated.readings[i] - observed[i]) * trajectory.channel[i].weight;
                 }
               });
}

void observe(const std::vector<Variant>& variants,
             const std::vector<ObservedTrajectory>& trajectories, const double* qpos,
             const double* qvel, int nthread, double* observations, const Interrupt& interrupt) {
  const std::vector<std::size_t> offsets =
      offsets_of(trajectories, &ObservedTrajectory::observations);
  simulate_all(
      variants, trajectories, qpos, qvel, nthread, interrupt,
      [&](int variant, int t, std::size_t frame, const Frame& simulated) {
        double* of_trajectory = observations + variant * offsets.back() + offsets[t];
        std::copy(simulated.poses.begin(), simulated.poses.end(),
                  of_trajectory + frame * simulated.poses.size());
        std::copy(simulated.readings.begin(), simulated.readings.end(),
                  of_trajectory + 7 * trajectories[t].poses() + frame * simulated.readings.size());
      });
}

}  // namespace dashpot
