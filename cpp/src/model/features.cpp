#include "dashpot/model/features.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <stdexcept>

#include "dashpot/model/checks.hpp"
#include "dashpot/model/constraints.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/host.hpp"
#include "dashpot/model/mocap_bodies.hpp"
#include "discrete.hpp"

namespace dashpot::host {

namespace {

#if mjVERSION_HEADER >= 4000000
constexpr int kSpeculative = mjENBL_SPECULATIVE;
#else
constexpr int kSpeculative = 0;
#endif

bool any_nonzero(const mjtNum* values, int count) {
  return std::any_of(values, values + count, [](mjtNum value) { return value != 0.0; });
}

bool is_known_integrator(const mjModel* m) {
  return m->opt.integrator >= mjINT_EULER && m->opt.integrator <= mjINT_DISCRETE;
}

struct Report {
  bool comfree() const { return law == Law::kComFree; }
  void add(const std::string& name, Treatment treatment, const std::string& note) {
    features.push_back({name, treatment, note});
  }
  Law law = Law::kKelvinVoigt;
  std::vector<Feature> features;
};

void report_solref(Report& report, const std::string& name, const mjtNum* solref,
                   const mjtNum* solimp, bool even_default = false) {
  if (even_default || !is_default_impedance(solref, solimp))
    report.add(
        name + " solref/solimp", Treatment::kMapped,
        report.comfree()
            ? "solimp sets the effective mass; stiffness and damping are the law's"
            : "spring-damper, where no material is set. A load at rest deforms it as far as in "
              "MuJoCo. At most as rigid as the micro-steps resolve; same damping ratio");
}

// The load of a limit or an equality is not known beforehand.
void report_scalar_solref(Report& report, const std::string& name, const mjtNum* solref,
                          const mjtNum* solimp, bool even_default = false) {
  const char* const note =
      "spring-damper as at the full impedance of solimp, at most as rigid as the micro-steps "
      "resolve. A load at rest deforms it as far as in MuJoCo if that is solimp's width or more; "
      "same damping ratio";
  if (report.comfree())
    report_solref(report, name, solref, solimp, even_default);
  else if (even_default || !is_default_impedance(solref, solimp))
    report.add(name + " solref/solimp", Treatment::kMapped, note);
}

// Dry friction loss of a joint or tendon. MuJoCo's holds nothing: a load F below it moves a joint
// of inertia m at F (1 - d_0) d_width timeconst / (2 d_0 m).
void report_friction_loss(Report& report, const std::string& name, const mjtNum* solref,
                          const mjtNum* solimp) {
  report.add(name + " frictionloss", Treatment::kMapped,
             "holds what loads it less, which in MuJoCo creeps as against a damper: an actuator "
             "that is weaker moves nothing");
  if (!report.comfree()) report_scalar_solref(report, name + " frictionloss", solref, solimp);
}

void report_disabled_rows(const mjOption& o, Report& report) {
  const auto add = [&](int flag, const char* name, const char* note) {
    if (o.disableflags & flag)
      report.add(std::string("flag ") + name + "=disable", Treatment::kHonoured, note);
  };
  add(mjDSBL_CONSTRAINT, "constraint",
      "no contacts are detected, and no equality, limit or dry friction acts");
  add(mjDSBL_CONTACT, "contact", "no contacts are detected");
  add(mjDSBL_EQUALITY, "equality", "no equality acts");
  add(mjDSBL_LIMIT, "limit", "no limit acts");
  add(mjDSBL_FRICTIONLOSS, "frictionloss", "no dry friction of joints or tendons acts");
}

void report_options(const mjModel* m, Report& report) {
  const mjOption& o = m->opt;
  static const char* const kIntegrators[] = {"Euler", "RK4", "implicit", "implicitfast",
                                             "discrete"};
  const std::string integrator =
      o.integrator >= 0 && o.integrator < 5 ? kIntegrators[o.integrator] : "unknown";
  if (!is_known_integrator(m))
    report.add("option integrator=" + integrator, Treatment::kRefused,
               "use discrete, Euler, implicitfast, implicit or RK4");
  else if (report.comfree() && is_discrete(m))
    report.add("option integrator=" + integrator, Treatment::kRefused,
               "law comfree goes by the masses of bodies alone; use law kelvin_voigt or Euler");
  else if (is_runge_kutta(m))
    report.add("option integrator=" + integrator, Treatment::kMapped,
               "where contacts, limits, equalities or dry friction are possible, trees follow "
               "velocity Verlet; models without any are stepped by mj_RungeKutta");
  else
    report.add("option integrator=" + integrator, Treatment::kHonoured,
               "it says which forces are implicit; trees follow velocity Verlet, but models that "
               "can have no rows are stepped by MuJoCo's own integrator");
  if (o.enableflags & mjENBL_SLEEP)
    report.add("flag sleep", Treatment::kHonoured,
               "islands are those of contacts that could touch in the step; trees that tendons or "
               "flexes join to one never sleep");
  if (o.enableflags & mjENBL_OVERRIDE)
    report.add("flag override", Treatment::kRefused,
               "contact parameters come from materials, not from o_solref and o_solimp");
  if (o.enableflags & mjENBL_IPC)
    report.add("flag ipc", Treatment::kRefused, "contacts belong to the discrete integrator");
  if (o.enableflags & kSpeculative)
    report.add("flag speculative", Treatment::kRefused, "fast contacts are found without it");
#if mjVERSION_HEADER < 3016000
  if (std::find(m->geom_type, m->geom_type + m->ngeom, mjGEOM_HFIELD) != m->geom_type + m->ngeom)
    report.add("height fields", Treatment::kRefused,
               "MuJoCo 3.15 finds them too near by one and a half margins; 3.16 does not");
#elif mjVERSION_HEADER >= 4000000
  if (m->nplastic > 0)
    report.add("plastic deformation", Treatment::kRefused,
               "springyield, yield and the twist of elastic rods change with mj_step alone");
#endif
  if (o.enableflags & mjENBL_FWDINV)
    report.add("flag fwdinv", Treatment::kMapped,
               "solver_fwdinv stays zero: mean forces of a step are no solution of mj_inverse");
  if (o.enableflags & mjENBL_DIAGEXACT)
    report.add("flag diagexact", Treatment::kMapped, "apparent masses are always exact");
  report_disabled_rows(o, report);
  report.add("option solver, iterations, tolerance, noslip_iterations, impratio",
             Treatment::kMapped, "contact is solved in closed form; nothing iterates");
  if (report.comfree())
    report.add("option ccd_tolerance, flag multiccd", Treatment::kHonoured,
               "contacts are those that MuJoCo finds");
  else
    report.add(
        "option ccd_tolerance, flag multiccd", Treatment::kMapped,
        "nearest points are searched to 1e-8 of the smaller half width, at most 1e-9 m, with "
        "capsules to 1e-4 of it or ccd_tolerance. What lies flat, on a side or along an edge "
        "has points of its own");
  report.add("option cone", Treatment::kMapped,
             report.comfree() ? "friction cones are pyramids" : "friction cones are elliptic");
}

void report_contacts(const mjModel* m, Report& report) {
  for (int flex = 0; flex < m->nflex; ++flex) {
    const std::string name = "flex " + named(m, mjOBJ_FLEX, flex);
    if (m->flex_passive[flex])
      report.add(name + " passive", Treatment::kRefused,
                 "its contacts are springs of MuJoCo's, not rows");
    else
      report.add(
          name, Treatment::kHonoured,
          "contact rows over its vertices; elasticity is MuJoCo's passive force, which discrete "
          "treats implicitly");
    report_solref(report, name, m->flex_solref + mjNREF * flex, m->flex_solimp + mjNIMP * flex);
  }
  for (int geom = 0; geom < m->ngeom; ++geom) {
    if (any_nonzero(m->geom_surfacevel + 6 * geom, 6))
      report.add("geom " + named(m, mjOBJ_GEOM, geom) + " surfacevel", Treatment::kHonoured,
                 "sliding and spin are those of the moving surface");
    if (m->geom_adhesion[geom] != 0.0)
      report.add("geom " + named(m, mjOBJ_GEOM, geom) + " adhesion", Treatment::kHonoured,
                 "pulls along the normals of the contacts at the start of a step");
    if (m->geom_contype[geom] == 0 && m->geom_conaffinity[geom] == 0) continue;
    report_solref(report, "geom " + named(m, mjOBJ_GEOM, geom), m->geom_solref + mjNREF * geom,
                  m->geom_solimp + mjNIMP * geom);
  }
  for (int pair = 0; pair < m->npair; ++pair) {
    const std::string name = "pair " + named(m, mjOBJ_PAIR, pair);
    report_solref(report, name, m->pair_solref + mjNREF * pair, m->pair_solimp + mjNIMP * pair);
    if (m->pair_adhesion[pair] != 0.0)
      report.add(name + " adhesion", Treatment::kHonoured,
                 "pulls along the normals of the contacts at the start of a step");
    const mjtNum* friction = m->pair_solreffriction + mjNREF * pair;
    if (friction[0] != 0.0 || friction[1] != 0.0)
      report.add(
          name + " solreffriction", Treatment::kMapped,
          report.comfree()
              ? "friction is that of the facets"
              : "friction is as rigid as micro-steps resolve, or a material's, critically damped");
  }
}

void report_sensors(const mjModel* m, Report& report) {
  for (int i = 0; i < m->nsensor; ++i)
    if (m->sensor_type[i] == mjSENS_TACTILE && !report.comfree())
      report.add("sensor " + named(m, mjOBJ_SENSOR, i) + " tactile", Treatment::kMapped,
                 "reads how deep geoms overlap, which is next to nothing where they are rigid: a "
                 "material makes it force over stiffness");
}

void report_mocap(const mjModel* m, Report& report) {
  for (int body = 0; body < m->nbody; ++body) {
    if (m->body_mocapid[body] < 0) continue;
    const std::string name = "body " + named(m, mjOBJ_BODY, body) + " mocap";
    if (report.comfree())
      report.add(name, Treatment::kHonoured, "is where its pose says, without velocity");
    else
      report.add(
          name, Treatment::kMapped,
          "moves to its pose, and what it touches or holds sees its velocity; where it holds "
          "something it follows within mocap_timeconst");
  }
}

void report_constraints(const mjModel* m, Report& report) {
  for (int i = 0; i < m->neq; ++i) {
    const std::string name = "equality " + named(m, mjOBJ_EQUALITY, i);
    const int type = m->eq_type[i];
    if (type == mjEQ_CONNECT || type == mjEQ_WELD || type == mjEQ_JOINT || type == mjEQ_TENDON ||
        type == mjEQ_FLEX || type == mjEQ_FLEXVERT || type == mjEQ_FLEXSTRAIN) {
      report.add(name, Treatment::kHonoured, "bilateral spring-damper rows");
      report_scalar_solref(report, name, m->eq_solref + mjNREF * i, m->eq_solimp + mjNIMP * i,
                           is_held_by_mocap(m, i));
    } else {
      report.add(name, Treatment::kRefused, "equalities of this type are not stepped");
    }
  }
  for (int i = 0; i < m->njnt; ++i) {
    const std::string name = "joint " + named(m, mjOBJ_JOINT, i);
    if (m->jnt_limited[i])
      report_scalar_solref(report, name + " range", m->jnt_solref + mjNREF * i,
                           m->jnt_solimp + mjNIMP * i);
  }
  for (int dof = 0; dof < m->nv; ++dof)
    if (m->dof_frictionloss[dof] > 0)
      report_friction_loss(report, "joint " + named(m, mjOBJ_JOINT, m->dof_jntid[dof]),
                           m->dof_solref + mjNREF * dof, m->dof_solimp + mjNIMP * dof);
  for (int i = 0; i < m->ntendon; ++i) {
    const std::string name = "tendon " + named(m, mjOBJ_TENDON, i);
    if (m->tendon_frictionloss[i] > 0)
      report_friction_loss(report, name, m->tendon_solref_fri + mjNREF * i,
                           m->tendon_solimp_fri + mjNIMP * i);
    if (m->tendon_limited[i])
      report_scalar_solref(report, name + " range", m->tendon_solref_lim + mjNREF * i,
                           m->tendon_solimp_lim + mjNIMP * i);
  }
  for (int i = 0; i < m->nactuator; ++i)
    if (m->actuator_trntype[i] == mjTRN_BODY)
      report.add("actuator " + named(m, mjOBJ_ACTUATOR, i) + " adhesion", Treatment::kHonoured,
                 "pulls along the normals of the contacts at the start of a step");
}

}  // namespace

void check_options(const mjModel_* m, Law law) {
  check_values(m);
  const mjOption& o = m->opt;
  if (o.cone != mjCONE_ELLIPTIC)
    throw std::invalid_argument("model.opt.cone is " + std::to_string(o.cone) +
                                "; the engine's model needs mjCONE_ELLIPTIC");
  if (!is_known_integrator(m) || (law == Law::kComFree && is_discrete(m)) ||
      o.enableflags & (mjENBL_OVERRIDE | mjENBL_IPC | kSpeculative))
    check_supported(m, law);
}

std::vector<Feature> features(const mjModel_* m, Law law) {
  Report report{law, {}};
  report_options(m, report);
  report_contacts(m, report);
  report_sensors(m, report);
  report_mocap(m, report);
  report_constraints(m, report);
  return report.features;
}

void check_supported(const mjModel_* m, Law law) {
  check_values(m);
  check_heights(m);
  std::string refused;
  for (const Feature& feature : features(m, law))
    if (feature.treatment == Treatment::kRefused)
      refused += (refused.empty() ? "" : "; ") + feature.name + " (" + feature.note + ")";
  if (!refused.empty()) throw std::invalid_argument("model uses what dashpot refuses: " + refused);
}

void check_supported(const mjModel_* m, const Options& options) {
  check_supported(m, options.law);
  if (options.impact != Impact::kCut) return;
  if (options.law != Law::kKelvinVoigt)
    throw std::invalid_argument("only law kelvin_voigt cuts steps at impacts");
  if (m->nflex > 0) throw std::invalid_argument("impact \"cut\" does not see flexes; use \"none\"");
}

}  // namespace dashpot::host
