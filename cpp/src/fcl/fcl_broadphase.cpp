#include "dashpot/fcl/fcl_broadphase.hpp"

#include <fcl/broadphase/broadphase_dynamic_AABB_tree.h>
#include <fcl/geometry/shape/box.h>
#include <fcl/narrowphase/collision_object.h>

#include <algorithm>
#include <cstdint>
#include <memory>

namespace dashpot {

namespace {

using Pairs = std::vector<std::pair<int, int>>;

int index_of(const fcl::CollisionObjectd* object) {
  return static_cast<int>(reinterpret_cast<std::intptr_t>(object->getUserData()));
}

bool add_pair(fcl::CollisionObjectd* object1, fcl::CollisionObjectd* object2, void* pairs) {
  const int i = index_of(object1), j = index_of(object2);
  static_cast<Pairs*>(pairs)->emplace_back(std::min(i, j), std::max(i, j));
  return false;  // go on
}

}  // namespace

Pairs overlapping_pairs(const std::vector<Eigen::AlignedBox3d>& boxes) {
  std::vector<std::unique_ptr<fcl::CollisionObjectd>> objects;
  fcl::DynamicAABBTreeCollisionManagerd manager;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    const auto shape = std::make_shared<fcl::Boxd>(boxes[i].sizes());
    objects.push_back(std::make_unique<fcl::CollisionObjectd>(shape, Eigen::Matrix3d::Identity(),
                                                              Eigen::Vector3d(boxes[i].center())));
    objects.back()->setUserData(reinterpret_cast<void*>(static_cast<std::intptr_t>(i)));
    objects.back()->computeAABB();
    manager.registerObject(objects.back().get());
  }
  manager.setup();
  Pairs pairs;
  manager.collide(&pairs, add_pair);
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

}  // namespace dashpot
