// Residuals of simulated against observed trajectories, for calibration.
//
// For every observed frame and body, with simulated pose (p, R) and observed pose (p_o, R_o):
//
//     position residual   (p - p_o) * position_weight                  world frame, by axis
//     rotation residual   log(R_o^T R) * rotation_weight               rotation vector, |.| <= pi
//
// and for every number s of its sensors, observed as s_o,
//
//     sensor residual     (s - s_o) * weight
//
// What positions and velocities make is compared at the frame. What needs accelerations and forces
// is held through a step, and compared as its mean over the steps before the frame, as recorders
// take it; at the first frame there is none, and 0.
//
// What was not measured has weight 0, and residuals of 0.
//
// A variant is a model with parameters. All variants x trajectories are simulated in one parallel
// batch; a Jacobian is made by finite differences between variants, so that it costs one batch.

#pragma once

#include <array>
#include <string>
#include <vector>

#include "dashpot/simulations/simulation_host.hpp"
#include "dashpot/threads/parallel.hpp"

namespace dashpot {

// A model and how it steps: with dashpot, or with mj_step where `parameters` is null.
struct Variant {
  const mjModel_* model = nullptr;
  const Parameters* parameters = nullptr;
};

// One number of sensordata.
struct ObservedChannel {
  int address = 0;
  bool mean = false;    // over the last `interval` steps; else of the frame itself
  double weight = 1.0;  // 1/unit, >= 0
};

// What was observed of one motion.
struct ObservedTrajectory {
  std::string name;
  double timestep = 0.0;           // s, of the simulation
  std::vector<int> frame_step;     // steps from the start to each observed frame, ascending, >= 0
  std::vector<int> body;           // observed bodies
  std::vector<double> position;    // (frames, bodies, 3), m
  std::vector<double> quaternion;  // (frames, bodies, 4), unit, w x y z
  std::vector<double> control;     // (last frame_step, nu), or empty: zero
  std::array<double, 3> position_weight = {1.0, 1.0, 1.0};  // 1/m, >= 0, of x, y, z
  double rotation_weight = 1.0;                             // 1/rad, >= 0
  std::vector<ObservedChannel> channel;                     // of sensors
  std::vector<double> reading;                              // (frames, channels), in their units
  int interval = 1;                                         // steps that means are taken over

  int frames() const { return static_cast<int>(frame_step.size()); }
  int bodies() const { return static_cast<int>(body.size()); }
  int poses() const { return frames() * bodies(); }
  int readings() const { return frames() * static_cast<int>(channel.size()); }
  int residuals() const { return 6 * poses() + readings(); }
  int observations() const { return 7 * poses() + readings(); }
};

// Throws std::invalid_argument naming the trajectory and the field whose size, order or value does
// not fit itself or the model.
void check(const ObservedTrajectory& trajectory, const ModelSizes& sizes);

// Numbers of all trajectories together.
std::size_t residual_count(const std::vector<ObservedTrajectory>& trajectories);
std::size_t observation_count(const std::vector<ObservedTrajectory>& trajectories);

// Simulates every variant from `qpos` (variants, trajectories, nq) and `qvel` (variants,
// trajectories, nv) without contact memory, and writes `residuals` (variants, residual_count):
// trajectories in order, within one (frames, bodies, 6), position before rotation, then (frames,
// channels). Identical bit for bit for every `nthread` (0: one per core). Throws
// std::invalid_argument naming the trajectory, variant and step of a simulation that fails, and
// what `interrupt` throws, which is asked between steps.
void residuals(const std::vector<Variant>& variants,
               const std::vector<ObservedTrajectory>& trajectories, const double* qpos,
               const double* qvel, int nthread, double* residuals, const Interrupt& interrupt = {});

// What is simulated instead of residuals: (variants, observation_count), within a trajectory
// (frames, bodies, 7), positions and quaternions, then (frames, channels).
void observe(const std::vector<Variant>& variants,
             const std::vector<ObservedTrajectory>& trajectories, const double* qpos,
             const double* qvel, int nthread, double* observations,
             const Interrupt& interrupt = {});

}  // namespace dashpot
