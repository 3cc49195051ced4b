#include "dashpot/islands/clamped_bodies.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/law/solref.hpp"
#include "dashpot/model/properties.hpp"

namespace dashpot {

namespace {

// Cosine of the angle from which on two pushes press what is between them.
constexpr double kOpposed = -0.5;
constexpr double kAside = 0.5;  // cosine of half that angle

bool follows_solref(const RowGroup& c, const GroupMaterial& given) {
  return c.kind == RowKind::kContact && given.from_solref;
}

double dot(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// By what has the inverse mass `loading`.
void press(const ContactInput& input, const Rows& rows, const RowGroup& c, double loading,
           GroupMaterial& given) {
  const double typical = rows.typical_inverse_mass[c.row];
  if (typical <= 0.0) return;
  const double damping =
      solref_to_spring_at_rest(input.solref, input.solimp, given.load, loading / typical)[1];
  // Rows have delta over sqrt(A w).
  const double scale = std::sqrt(rows.bounded_inverse_mass(c.row) / typical);
  given.normalised_damping = std::max(given.normalised_damping, damping * scale);
  given.is_clamped = true;
}

}  // namespace

// On the body of one of a contact's geoms, by the other's.
ClampedBodies::Push ClampedBodies::push_of(const mjModel_* model, const ContactInput& input,
                                           int side) {
  const double sign = side == 0 ? -1.0 : 1.0;
  return {host::moved_body(model, input.geom[side]),
          input.tree[1 - side],
          {sign * input.frame[0], sign * input.frame[1], sign * input.frame[2]}};
}

// All pushes within 60 degrees of their mean, as those on a tray, leave no two that are opposed.
bool ClampedBodies::any_opposed(const Push* first, const Push* last) {
  std::array<double, 3> mean{};
  for (const Push* push = first; push != last; ++push)
    for (int i = 0; i < 3; ++i) mean[i] += push->direction[i];
  const double length = std::sqrt(dot(mean, mean));
  if (std::all_of(first, last,
                  [&](const Push& push) { return dot(push.direction, mean) > kAside * length; }))
    return false;
  return std::any_of(first, last, [&](const Push& push) {
    return std::any_of(&push + 1, last, [&](const Push& other) {
      return dot(push.direction, other.direction) < kOpposed;
    });
  });
}

void ClampedBodies::find_pressed_bodies(const mjModel_* model,
                                        const std::vector<ContactInput>& contacts,
                                        const Rows& rows) {
  pushes_.clear();
  for (const RowGroup& c : rows.group) {
    if (c.kind != RowKind::kContact || contacts[c.input].gap >= 0.0) continue;
    for (int side = 0; side < 2; ++side) {
      const Push push = push_of(model, contacts[c.input], side);
      if (push.body >= 0) pushes_.push_back(push);
    }
  }
  std::sort(pushes_.begin(), pushes_.end(),
            [](const Push& a, const Push& b) { return a.body < b.body; });
  pressed_.clear();
  for (auto first = pushes_.begin(), last = first; first != pushes_.end(); first = last) {
    last = std::find_if(first, pushes_.end(),
                        [&](const Push& push) { return push.body != first->body; });
    if (any_opposed(&*first, &*first + (last - first))) pressed_.push_back(first->body);
  }
}

bool ClampedBodies::is_pressed(int body) const {
  return body >= 0 && std::binary_search(pressed_.begin(), pressed_.end(), body);
}

void ClampedBodies::find(const mjModel_* model, const std::vector<ContactInput>& contacts,
                         const Rows& rows, std::vector<GroupMaterial>& materials) {
  find_pressed_bodies(model, contacts, rows);
  if (pressed_.empty()) return;
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (!follows_solref(c, materials[i])) continue;
    const ContactInput& input = contacts[c.input];
    if (input.gap >= 0.0 || input.tree[0] == input.tree[1]) continue;
    bool pressed = false;
    double loading = 0.0;  // inverse mass of what loads the contact
    for (int side = 0; side < 2; ++side) {
      const Push push = push_of(model, input, side);
      if (!is_pressed(push.body)) continue;
      pressed = true;
      if (!is_pressed(host::moved_body(model, input.geom[1 - side])))
        loading = c.tree[0] == push.tree   ? rows.tree_inverse_mass[c.row][0]
                  : c.tree[1] == push.tree ? rows.tree_inverse_mass[c.row][1]
                                           : 0.0;
    }
    if (pressed) press(input, rows, c, loading, materials[i]);
  }
}

}  // namespace dashpot
