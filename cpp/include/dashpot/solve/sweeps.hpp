// The sweeps of a micro-step over rows and trees, four groups or four coordinates at a time.
//
// They are compiled for several instruction sets (sweep_kernels.hpp), each in a file of its own:
// vectors that an instruction set does not have are taken apart before functions are inlined into
// others, so a function compiled for a wider one, made of parts that are not, took twice the time.
// Lanes do not mix and nothing is fused, so all give the same bits.

#pragma once

#include <tuple>

#include "dashpot/rows/trees.hpp"
#include "dashpot/solve/contact_lanes.hpp"
#include "dashpot/solve/jacobian_lanes.hpp"

namespace dashpot {

// Four groups with the same kind of Jacobian and law.
template <typename Jacobian, typename Law>
struct Block {
  static constexpr int kDim = sizeof(Law::rate) / sizeof(Lanes);
  Jacobian jacobian{};
  Law law{};
};

// One of every kind of block that there is.
template <template <typename Jacobian, typename Law> class Of>
using OfEveryKind = std::tuple<Of<PairLanes, ContactLanes<1>>, Of<PairLanes, ContactLanes<3>>,
                               Of<PairLanes, ContactLanes<4>>, Of<PairLanes, ContactLanes<6>>,
                               Of<SparseLanes, ContactLanes<1>>, Of<SparseLanes, ContactLanes<3>>,
                               Of<SparseLanes, ContactLanes<4>>, Of<SparseLanes, ContactLanes<6>>,
                               Of<SparseLanes, SpringLanes>, Of<JointLanes, ContactLanes<1>>,
                               Of<JointLanes, SpringLanes>>;

// Blocks of one kind that follow one another.
template <typename Jacobian, typename Law>
struct BlockRange {
  Block<Jacobian, Law>* first = nullptr;
  Block<Jacobian, Law>* last = nullptr;
};
using BlockRanges = OfEveryKind<BlockRange>;

// A tree of an island, and which other slices of its rows act on it, by bit.
struct IslandTree {
  Tree tree;
  unsigned slices = 0;
  Trees::Entries implicit = {nullptr, nullptr};  // of an elastic tree
  const Trees* trees = nullptr;                  // of a sparse one
  int index = 0;
};

// The arrays of one island's micro-steps, per motion coordinate: what rows apply are forces,
// impulses and, of all micro-steps together, moments of the impulses; `acceleration` is the one
// with all present forces, `displacement` that of all micro-steps.
struct IslandMotion {
  double h = 0.0;
  Recovery recovery;
  double coupled_time = 0.0;  // for end_displacement()
  // Times for turn_rows(), from the start of the step on.
  double rate_time = 0.0, work_time = 0.0;
  double *velocity, *displacement, *acceleration;
  double *force, *impulse, *moment;
  double *total_displacement, *coordinate_impulse;
  // What rows of slices after the first apply (island_blocks.hpp): forces, impulses, then what goes
  // to coordinate_impulse and moment, those of a slice `slice_size` after those of the one before.
  double *force_of_slices, *impulse_of_slices;
  int slice_size;
  const double *smooth_acceleration, *inverse;
  // For the drag of damped trees.
  const double *start_motion, *added, *damping, *cross_damping;
  double step = 0.0;  // T
  double *slowing, *drag, *braked;
  // Of sprung trees: how far they have gone, and what their springs pull with because of that.
  const double* stiffness;
  double *way, *pull, *pulled;
};

// A micro-step is four sweeps, over rows and trees in turn; one sweep over rows comes before the
// first micro-step, and three sweeps after the last.
enum class Sweep {
  kPrepare,        // rows, before all micro-steps: what depends on parameters and h alone
  kPresentForces,  // rows: motion of the last micro-step, then the forces all rows have now
  kSmoothMotion,   // trees: acceleration with those forces; motion without the rows' impulses
  kFlow,           // rows: closed-form flow of every row under its load
  kContactMotion,  // trees: the velocity that the impulses cause
  kRead,           // rows, after all micro-steps: motion of the last, sums of impulses and moments
  kDisplacement,   // trees: the displacement that the moments cause
  kFollow          // rows: springs follow the displacement of the bodies
};

// All sweeps, compiled for one instruction set. Each takes the kinds of Sweep that are its own.
struct SweepFunctions {
  void (*rows)(Sweep sweep, const BlockRanges& blocks, const IslandMotion& motion);
  void (*trees)(Sweep sweep, const IslandTree* first, const IslandTree* last,
                const IslandMotion& motion);
};
extern const SweepFunctions kPortableSweeps;
#if defined(__x86_64__)
extern const SweepFunctions kAvx2Sweeps, kAvx512Sweeps;
bool has_avx2();
bool has_avx512();
#endif

// Environment variable that asks for those of another instruction set than the best: "portable",
// "avx2" or "avx512". For tests and measurements of what processors without the best have.
inline constexpr const char* kInstructionSetVariable = "DASHPOT_INSTRUCTION_SET";

// Those of the best instruction set that the processor has, or of the one that is asked for. Throws
// std::invalid_argument where the processor does not have that.
const SweepFunctions& fastest_sweeps();

}  // namespace dashpot
