#include "dashpot/simulations/recordings.hpp"

#include <algorithm>
#include <limits>
#include <memory>
#include <stdexcept>

namespace dashpot {
namespace {

[[noreturn]] void fail(const Recording& recording, const std::string& what) {
  throw std::invalid_argument("trajectory '" + recording.name + "': " + what);
}

// Sums of the channels that are means, over the last steps before a reading.
class Means {
 public:
  explicit Means(const Recording& recording)
      : recording_(recording), sum_(recording.channel.size()) {
    for (const Channel& channel : recording.channel) (channel.mean ? any_ : any_other_) = true;
  }

  bool any_other() const { return any_other_; }

  // After a step, of which `left` come before the next reading.
  void add(const Simulation& simulation, int left) {
    if (!any_ || left >= recording_.interval) return;
    const double* values = simulation.sensordata();
    for (std::size_t i = 0; i < sum_.size(); ++i) sum_[i] += values[recording_.channel[i].address];
    ++count_;
  }

  double take(std::size_t channel) {
    const double mean = sum_[channel] / std::max(count_, 1);
    sum_[channel] = 0.0;
    return mean;
  }

  void restart() { count_ = 0; }

 private:
  const Recording& recording_;
  std::vector<double> sum_;
  int count_ = 0;
  bool any_ = false, any_other_ = false;
};

// Writes one row of readings.
void read(Simulation& simulation, const Recording& recording, Means& means, double* out) {
  if (means.any_other())
    simulation.update_sensors();
  else
    simulation.update_kinematics();
  for (const int body : recording.body) {
    simulation.body_pose(body, out, out + 3);
    out += 7;
  }
  for (std::size_t i = 0; i < recording.channel.size(); ++i) {
    const Channel& channel = recording.channel[i];
    const double mean = means.take(i);
    *out++ = channel.mean ? mean : simulation.sensordata()[channel.address];
  }
  means.restart();
  if (recording.gap.empty()) return;
  double gap = std::numeric_limits<double>::infinity();
  for (const auto& [geom1, geom2] : recording.gap)
    gap = std::min(gap, simulation.distance(geom1, geom2));
  *out = gap;
}

void simulate(Simulation& simulation, const Recording& recording, int nu, const Item& item,
              const Worker& worker, double* out) {
  simulation.set_timestep(recording.timestep);
  simulation.reset();
  simulation.set_position_velocity(item.qpos, item.qvel);
  Means means(recording);
  int step = 0;
  for (const int record_step : recording.record_step) {
    for (; step < record_step; ++step) {
      worker.look();
      if (!recording.control.empty())
        simulation.set_control(recording.control.data() + std::size_t(step) * nu);
      try {
        simulation.step();
      } catch (const std::exception& error) {
        throw std::invalid_argument("step " + std::to_string(step) + ": " + error.what());
      }
      means.add(simulation, record_step - 1 - step);
    }
    read(simulation, recording, means, out);
    out += recording.row();
  }
}

}  // namespace

void check(const Recording& recording, const ModelSizes& sizes) {
  if (recording.size() == 0) fail(recording, "has no frame, or neither body, sensor nor gap");
  if (!(recording.timestep > 0.0)) fail(recording, "timestep must be > 0");
  if (recording.interval < 1) fail(recording, "interval must be >= 1");
  for (std::size_t i = 0; i < recording.record_step.size(); ++i) {
    if (recording.record_step[i] < (i == 0 ? 0 : recording.record_step[i - 1] + 1)) {
      fail(recording,
           "record_step must be >= 0 and ascend; it does not at index " + std::to_string(i));
    }
  }
  const auto in_model = [&](const char* what, int index, int count) {
    if (index < 0 || index >= count)
      fail(recording, std::string(what) + " " + std::to_string(index) + " is not in the model");
  };
  for (const int body : recording.body) in_model("body", body, sizes.nbody);
  for (const Channel& channel : recording.channel)
    in_model("channel", channel.address, sizes.nsensordata);
  for (const auto& [geom1, geom2] : recording.gap) {
    in_model("geom", geom1, sizes.ngeom);
    in_model("geom", geom2, sizes.ngeom);
  }
  if (!recording.control.empty() &&
      recording.control.size() < std::size_t(recording.record_step.back()) * sizes.nu)
    fail(recording, "control has fewer rows than the simulation has steps");
}

std::vector<std::string> record(const std::vector<Variant>& variants,
                                const std::vector<Recording>& recordings,
                                const std::vector<Item>& items, int nthread, double* readings,
                                const Interrupt& interrupt) {
  std::vector<std::string> failures(items.size());
  if (items.empty()) return failures;
  const ModelSizes sizes = sizes_of(variants.front().model);
  for (const Variant& variant : variants) {
    const ModelSizes other = sizes_of(variant.model);
    if (other.nq != sizes.nq || other.nv != sizes.nv || other.nu != sizes.nu ||
        other.nbody != sizes.nbody || other.ngeom != sizes.ngeom ||
        other.nsensordata != sizes.nsensordata) {
      throw std::invalid_argument(
          "the variants' models differ in nq, nv, nu, nbody, ngeom or sensors");
    }
  }
  for (const Recording& recording : recordings) check(recording, sizes);
  std::vector<std::size_t> place;
  std::size_t end = 0;
  for (const Item& item : items) {
    place.push_back(end);
    end += std::size_t(recordings[item.recording].size());
  }

  const int threads = thread_count(nthread, static_cast<int>(items.size()));
  struct Own {
    int variant = -1;
    std::unique_ptr<Simulation> simulation;
  };
  std::vector<Own> of_worker(threads);
  parallel_for(
      static_cast<int>(items.size()), threads, interrupt, [&](const Worker& worker, int index) {
        const Item& item = items[index];
        const Recording& recording = recordings[item.recording];
        Own& own = of_worker[worker.index()];
        try {
          if (own.variant != item.variant) {
            const Variant& variant = variants[item.variant];
            own.variant = -1;
            own.simulation = std::make_unique<Simulation>(variant.model, variant.parameters);
            own.variant = item.variant;
          }
          simulate(*own.simulation, recording, sizes.nu, item, worker, readings + place[index]);
        } catch (const std::exception& error) {
          own.variant = -1;  // what a failed step leaves behind is not gone on with
          failures[index] = "trajectory '" + recording.name + "': " + error.what();
        }
      });
  return failures;
}

}  // namespace dashpot
