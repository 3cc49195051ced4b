// Detection of contacts and limits.

#pragma once

#include <vector>

#include "dashpot/detect/candidates.hpp"
#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/detect/internal_edges.hpp"
#include "dashpot/detect/narrowing.hpp"
#include "dashpot/detect/narrowphase.hpp"
#include "dashpot/detect/reach.hpp"
#include "dashpot/detect/scratch.hpp"
#include "dashpot/model/springs_and_dampers.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot::host {

// MuJoCo's rows of contacts, which its force queries read: none, left out where the memory of the
// model is too small for them, or required.
enum class ContactRows { kNone, kIfTheyFit, kRequired };

// How to detect, and what detection keeps from step to step.
struct Detection {
  ContactRows contact_rows = ContactRows::kRequired;
  bool takes_faces = true;  // see detect/collisions.hpp
  bool looks_ahead = true;  // also finds what may only begin within the step
  FaceBuffers faces;
  ReachBuffers buffers;
  Narrowing narrowing;
  CandidatePairs candidates;
  Narrowphase narrowphase;
  InternalEdgeBuffers internal_edges;
  Scratch scratch;
  std::vector<char> may_be_loaded;  // by contact found
  std::vector<RowDamper> dampers;   // that act as rows
};

// Whether any contact, limit, equality or dry friction could act in some state of a model, as it is
// now: its flags and values may be edited between steps. Trees of a model without any are MuJoCo's
// to integrate, bit for bit.
bool may_have_rows(const mjModel_* m);

// Whether anything may read MuJoCo's rows of contacts within a step: sensors, plugins, and the
// contacts of flexes. Callbacks cannot: but for those of sensors they are asked before detection.
bool anything_reads_rows(const mjModel_* m);

// Collision and limits with a reach that covers the motion of every body and joint in this step,
// and MuJoCo's own constraint rows for what was found, those of contacts as `detection` asks. The
// model's gaps and margins are widened during the call and restored. Throws std::runtime_error
// where contacts or required rows exceed the memory of the model.
// `acceleration` is the smooth generalized acceleration over the step (nv), `last_displacement` how
// far each degree of freedom went in the last one (nv), or null.
void detect(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
            const double* last_displacement, Detection& detection,
            std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints,
            Team& team);
// The contacts of the present positions within the model's own margins and gaps, from where
// adhesion pulls: the points that detect() finds there. Those of MuJoCo's own collision would be
// others on faces that lie flat, and the pull would turn bodies about the points that bear it.
// Velocities may not be known yet, and do not count. Throws as detect() does.
void find_present_contacts(mjModel_* m, mjData_* d, Detection& detection);
// The part of detect() that may be repeated within a step: the reach is at least what
// detection.buffers ask for.
void detect_rows(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
                 Detection& detection, std::vector<ContactInput>& contacts,
                 std::vector<ConstraintInput>& constraints, Team& team);

// While it lives, `d` holds kinematics, inertia, contacts and constraint rows, those of contacts as
// `detection` asks, of the configuration to which smooth motion with `acceleration` (nv) brings it
// in half of the model's time step. leave() brings back positions, kinematics and inertia of the
// present state. Without it, as where detection or anything else throws, its end brings back the
// positions, and the others as far as MuJoCo finds room for them: the next step finds them anew.
class MiddleGeometry {
 public:
  MiddleGeometry(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
                 Detection& detection, std::vector<ContactInput>& contacts,
                 std::vector<ConstraintInput>& constraints, Team& team);

  // Throws what MuJoCo throws.
  void leave() { start_.restore(); }

 private:
  // The configuration when it was made.
  class Start {
   public:
    Start(const mjModel_* m, mjData_* d);
    ~Start();
    Start(const Start&) = delete;
    Start& operator=(const Start&) = delete;

    void restore();

   private:
    const mjModel_* model_;
    mjData_* data_;
    std::vector<double> position_;
    bool restored_ = false;
  };
  Start start_;
};

}  // namespace dashpot::host
