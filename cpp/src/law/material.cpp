// Contact materials: combination and conversions.
//
// Two materials in contact are two springs in series, 1/k = 1/k1 + 1/k2; a rigid side has no
// compliance. Side i takes the share s_i = (1/k_i) / (1/k1 + 1/k2) of the elastic energy.
//
// Damping, rule "series":
//   both in N s/m:     d = d1 d2 / (d1 + d2), two dashpots in series;
//   both as ratio or restitution (first turned into a ratio):  zeta = s1 zeta1 + s2 zeta2, the mean
//       of the damping ratios weighted by elastic energy (modal strain energy: Ungar and Kerwin,
//       "Loss factors of viscoelastic systems in terms of energy concepts", J. Acoust. Soc. Am. 34,
//       1962);
//   one of each:       zeta = s1 zeta1 and, added to it, d = s2^2 d2: a dashpot that takes the
//       share s2 of the rate dissipates s2^2 d2 u^2.
// That of a side beside one that nobody set is taken whole, and that of a soft side beside a rigid
// one, unless both are in N s/m.
//
// Restitution of a Kelvin-Voigt contact that releases when its force reaches zero, without load:
// release comes at the phase omega t = 2 psi, which gives
//     e = exp(-2 zeta psi / sin psi),    cos psi = zeta    (zeta <= 1),
//     e = exp(-2 zeta eta / sinh eta),   cosh eta = zeta   (zeta >= 1),
// e = exp(-2) at zeta = 1 and e -> 1/(4 zeta^2) for large zeta. It is the closed form of Schwager
// and Poeschel, "Coefficient of restitution and linear-dashpot model revisited", Granular Matter 9,
// 2007, without its case distinctions.

#include "dashpot/law/material.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "dashpot/law/constants.hpp"
#include "dashpot/law/text.hpp"

namespace dashpot {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double mean_of(double x, double y) { return x == y ? x : 0.5 * x + 0.5 * y; }

// Weighted mean that returns equal arguments unchanged and ignores a side of weight 0.
double blend(double x, double y, double weight_x, double weight_y) {
  if (x == y || weight_y == 0.0) return x;
  if (weight_x == 0.0) return y;
  return weight_x * x + weight_y * y;
}

double select(DampingRule rule, double x, double y) {
  switch (rule) {
    case DampingRule::kMin:
      return std::min(x, y);
    case DampingRule::kMax:
      return std::max(x, y);
    default:
      return mean_of(x, y);
  }
}

double combine_friction(FrictionRule rule, double x, double y) {
  if (std::isnan(x)) return y;
  if (std::isnan(y)) return x;
  switch (rule) {
    case FrictionRule::kMin:
      return std::min(x, y);
    case FrictionRule::kMean:
      return mean_of(x, y);
    case FrictionRule::kGeometricMean:
      return x == y ? x : std::sqrt(x) * std::sqrt(y);
    default:
      return std::max(x, y);
  }
}

// The sliding friction under heavy load combines as that under light load does; where only one side
// has a load at which it changes, that load is the pair's.
void combine_load(const Material& a, const Material& b, FrictionRule rule, Material& pair) {
  double mu_a = a.friction[0], mu_b = b.friction[0];
  if (std::isnan(mu_a)) mu_a = std::isnan(mu_b) ? 1.0 : mu_b;
  if (std::isnan(mu_b)) mu_b = mu_a;
  const double light = combine_friction(rule, mu_a, mu_b);
  const double heavy = combine_friction(rule, mu_a * a.loaded_friction, mu_b * b.loaded_friction);
  const auto [low, high] = std::minmax(a.loaded_friction, b.loaded_friction);
  pair.loaded_friction = light > 0.0 ? std::min(std::max(heavy / light, low), high) : high;
  const double loss_a = mu_a * (1.0 - a.loaded_friction);
  const double loss_b = mu_b * (1.0 - b.loaded_friction);
  const double loss = loss_a + loss_b;
  pair.friction_load = loss > 0.0
                           ? blend(a.friction_load, b.friction_load, loss_a / loss, loss_b / loss)
                           : mean_of(a.friction_load, b.friction_load);
}

void combine_stiffness(const Material& a, const Material& b, StiffnessRule rule, Material& pair) {
  const double ka = a.rigid ? kInfinity : a.stiffness;
  const double kb = b.rigid ? kInfinity : b.stiffness;
  double k = 0.0;
  switch (rule) {
    case StiffnessRule::kSeries:
      k = a.rigid || b.rigid ? std::min(ka, kb)
                             : std::min(ka, kb) / (1.0 + std::min(ka, kb) / std::max(ka, kb));
      break;
    case StiffnessRule::kMin:
      k = std::min(ka, kb);
      break;
    case StiffnessRule::kMax:
      k = std::max(ka, kb);
      break;
    case StiffnessRule::kMean:
      k = mean_of(ka, kb);
      break;
  }
  pair.rigid = std::isinf(k);
  pair.stiffness = pair.rigid ? 0.0 : k;
}

double ratio_of(const Material& m) {
  return m.form == DampingForm::kRestitution ? restitution_to_damping_ratio(m.damping) : m.damping;
}

// share_a + share_b = 1 are the shares of elastic energy.
void combine_damping(const Material& a, const Material& b, DampingRule rule, double share_a,
                     double share_b, Material& pair) {
  const bool absolute_a = a.form == DampingForm::kDamping;
  const bool absolute_b = b.form == DampingForm::kDamping;
  pair.form = DampingForm::kRatio;
  pair.added_damping = 0.0;
  const auto take_whole = [&](const Material& side) {
    pair.form = side.form == DampingForm::kDamping ? DampingForm::kDamping : DampingForm::kRatio;
    pair.damping = ratio_of(side);
  };
  if (a.from_model != b.from_model) {
    take_whole(a.from_model ? b : a);
  } else if (absolute_a && absolute_b) {
    pair.form = DampingForm::kDamping;
    if (rule == DampingRule::kSeries) {
      const double low = std::min(a.damping, b.damping), high = std::max(a.damping, b.damping);
      pair.damping = low > 0.0 ? low / (1.0 + low / high) : 0.0;
    } else {
      pair.damping = select(rule, a.damping, b.damping);
    }
  } else if (a.rigid != b.rigid) {
    // The pair is as stiff as one side alone, which deforms alone.
    take_whole(pair.rigid == a.rigid ? a : b);
  } else if (!absolute_a && !absolute_b) {
    const double x = ratio_of(a);
    const double y = a.form == b.form && a.damping == b.damping ? x : ratio_of(b);
    pair.damping =
        rule == DampingRule::kSeries ? blend(x, y, share_a, share_b) : select(rule, x, y);
  } else {
    const double ratio = ratio_of(absolute_a ? b : a);
    const double damping = absolute_a ? a.damping : b.damping;
    const double share = absolute_a ? share_a : share_b;
    switch (rule) {
      case DampingRule::kSeries:
        pair.damping = (absolute_a ? share_b : share_a) * ratio;
        pair.added_damping = share * share * damping;
        break;
      case DampingRule::kMean:
        pair.damping = 0.5 * ratio;
        pair.added_damping = 0.5 * damping;
        break;
      default:
        throw std::invalid_argument(
            "combination rule damping='min' or 'max' cannot compare damping = " + text(damping) +
            " N s/m with damping ratio = " + text(ratio) +
            "; give both materials' damping in the same form");
    }
  }
}

// 2 zeta psi / sin psi = -log(restitution), for zeta <= 1.
double restitution_exponent(double zeta) {
  const double sine = std::sqrt((1.0 - zeta) * (1.0 + zeta));
  return sine > 0.0 ? 2.0 * zeta * (std::acos(zeta) / sine) : 2.0;
}

// sinh(eta) where cosh(eta) = zeta >= 1, without overflow.
double hyperbolic_sine(double zeta) { return std::sqrt(zeta - 1.0) * std::sqrt(zeta + 1.0); }

// Near critical damping the closed form cancels. Its expansion to first order is good to 1e-6 up to
// here, and only sets the speed of convergence.
constexpr double kNearCritical = 1e-3;

// -d log(restitution) / d zeta.
double restitution_slope(double zeta) {
  const double beyond = zeta - 1.0;
  if (std::fabs(beyond) < kNearCritical) return 4.0 / 3.0 - 0.8 * beyond;
  if (zeta < 1.0) {
    const double sine = std::sqrt((1.0 - zeta) * (1.0 + zeta));
    return 2.0 * (std::acos(zeta) - zeta * sine) / (sine * sine * sine);
  }
  const double sine = hyperbolic_sine(zeta);
  return 2.0 * (zeta / sine - std::acosh(zeta) / sine / sine) / sine;
}

}  // namespace

Material combine(const Material& a, const Material& b, const CombinationRules& rules) {
  Material pair;
  combine_stiffness(a, b, rules.stiffness, pair);

  double share_a = 0.5, share_b = 0.5;
  if (a.rigid != b.rigid) {
    share_a = a.rigid ? 0.0 : 1.0;
    share_b = 1.0 - share_a;
  } else if (!a.rigid) {
    share_a = 1.0 / (1.0 + a.stiffness / b.stiffness);
    share_b = 1.0 / (1.0 + b.stiffness / a.stiffness);
  }
  combine_damping(a, b, rules.damping, share_a, share_b, pair);

  pair.has_friction = a.has_friction || b.has_friction;
  if (pair.has_friction)
    for (std::size_t i = 0; i < pair.friction.size(); ++i)
      pair.friction[i] = combine_friction(rules.friction, a.friction[i], b.friction[i]);

  combine_load(a, b, rules.friction, pair);

  // Tangential springs in series too; their damping is weighted by their own elastic energy.
  const double compliance_a = share_a / a.tangential_ratio;
  const double compliance_b = share_b / b.tangential_ratio;
  const double compliance = compliance_a + compliance_b;
  pair.tangential_ratio =
      a.tangential_ratio == b.tangential_ratio ? a.tangential_ratio : 1.0 / compliance;
  pair.tangential_damping_ratio = blend(a.tangential_damping_ratio, b.tangential_damping_ratio,
                                        compliance_a / compliance, compliance_b / compliance);
  return pair;
}

double damping_ratio_to_restitution(double damping_ratio) {
  if (!(damping_ratio >= 0.0))
    throw std::invalid_argument("damping_ratio must be >= 0, got " + text(damping_ratio));
  if (damping_ratio <= 1.0) return std::exp(-restitution_exponent(damping_ratio));
  if (std::isinf(damping_ratio)) return 0.0;
  // exp(-2 eta zeta/sinh) = exp(-2 eta) exp(-2 eta (zeta - sinh)/sinh), exp(-eta) = zeta - sinh.
  const double sine = hyperbolic_sine(damping_ratio);
  const double decay = 1.0 / (damping_ratio + sine);
  return decay * std::exp(-2.0 * std::acosh(damping_ratio) * decay / sine) * decay;
}

double restitution_to_damping_ratio(double restitution) {
  if (!(restitution >= 0.0 && restitution <= 1.0))
    throw std::invalid_argument("restitution must be in [0, 1], got " + text(restitution));
  if (restitution == 0.0) return kInfinity;
  if (restitution == 1.0) return 0.0;
  const double exponent = -std::log(restitution);
  // -log(e) grows with zeta and is concave, so Newton from below converges monotonically. pi zeta
  // (its tangent at 0) and e < 1/(4 zeta^2) bound the root from below and from above.
  double zeta = exponent < 2.0 ? exponent / kPi : 0.5 / std::sqrt(restitution);
  for (int iteration = 0; iteration < 50; ++iteration) {
    const double residual =
        zeta <= 1.0 ? exponent - restitution_exponent(zeta)
                    : std::log1p((damping_ratio_to_restitution(zeta) - restitution) / restitution);
    const double step = std::max(residual / restitution_slope(zeta), -0.5 * zeta);
    zeta += step;
    if (std::fabs(step) <= 2.0 * std::numeric_limits<double>::epsilon() * zeta) break;
  }
  return zeta;
}

double damping_of(const Material& material, double stiffness, double inverse_mass) {
  if (material.form == DampingForm::kDamping) return material.damping + material.added_damping;
  return 2.0 * ratio_of(material) * std::sqrt(stiffness / inverse_mass) + material.added_damping;
}

}  // namespace dashpot
