#include "backend/localisation/place_evidence.h"

#include <gtest/gtest.h>

#include "tests/support/scenes/seen_rooms.h"

namespace lamina {
namespace {

TEST(PlaceEvidence, WhatStandsInTheQueryAloneIsNotMet) {
  World furnished = EmptyRoom();
  furnished.facets.push_back(Board());
  const Submap place = SeenRoom(EmptyRoom(), 1), query = SeenRoom(furnished, 2);
  const OccupiedLeaves leaves(place);
  const SE3 T_place_query = place.T_world_submap.Inverse() * query.T_world_submap;
  EXPECT_GT(leaves.Met(Means(SeenRoom(EmptyRoom(), 3)), T_place_query), 0.995);
  EXPECT_LT(leaves.Met(Means(query), T_place_query), 0.98);
}

}  // namespace
}  // namespace lamina
