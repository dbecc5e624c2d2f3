#include "backend/submaps/submap_registration.h"

#include <gtest/gtest.h>

#include <string>

namespace lamina {
namespace {

SubmapMatch GoodMatch() {
  SubmapMatch match;
  match.met_planes = true;
  match.planes = 500;
  match.overlap = 0.9;
  match.structure = 0.8;
  match.residual_sigmas = 0.4;
  match.facing = 30.0;
  match.gone = 0.001;
  match.looks = 2000;
  return match;
}

std::string RefusalOf(const SubmapMatch& match) { return Refusal(match, VerificationOptions()); }

TEST(SubmapRegistration, EachKindOfEvidenceIsNeeded) {
  EXPECT_EQ(RefusalOf(GoodMatch()), "");
  SubmapMatch match = GoodMatch();
  match.met_planes = false;
  EXPECT_EQ(RefusalOf(match), "registration did not converge");
  match = GoodMatch();
  match.planes = 59;
  EXPECT_EQ(RefusalOf(match), "few planes agree");
  match = GoodMatch();
  match.structure = 0.44;
  EXPECT_EQ(RefusalOf(match), "structure does not agree");
  match = GoodMatch();
  match.residual_sigmas = 1.6;
  EXPECT_EQ(RefusalOf(match), "planes do not fit");
  match = GoodMatch();
  match.gone = 0.1;
  EXPECT_EQ(RefusalOf(match), "what one has the other saw past");
  match = GoodMatch();
  match.facing = 3.9;
  EXPECT_EQ(RefusalOf(match), "open along a horizontal direction");
}

TEST(SubmapRegistration, LessOverlapIsEnoughWhereNothingOfMuchIsGone) {
  SubmapMatch match = GoodMatch();
  match.overlap = 0.5;
  EXPECT_EQ(RefusalOf(match), "");
  match.looks = 200;  // too little to say that all is there
  EXPECT_EQ(RefusalOf(match), "planes do not agree");
  match.overlap = 0.7;
  EXPECT_EQ(RefusalOf(match), "");
  match = GoodMatch();
  match.overlap = 0.5;
  match.gone = 0.01;
  EXPECT_EQ(RefusalOf(match), "planes do not agree");
  match = GoodMatch();
  match.overlap = 0.39;
  EXPECT_EQ(RefusalOf(match), "planes do not agree");
  // An option below that is the limit itself.
  VerificationOptions options;
  options.min_overlap = 0.3;
  EXPECT_EQ(Refusal(match, options), "");
}

SubmapMatch MatchOf(int planes, double overlap, double structure, double residual_sigmas) {
  SubmapMatch match = GoodMatch();
  match.planes = planes;
  match.overlap = overlap;
  match.structure = structure;
  match.residual_sigmas = residual_sigmas;
  return match;
}

TEST(SubmapRegistration, ARoomTurnedByHalfATurnFitsClearlyWorse) {
  const SubmapMatch right = MatchOf(1010, 0.973, 0.9995, 0.251);
  const SubmapMatch turned = MatchOf(892, 0.956, 0.948, 0.415);
  EXPECT_TRUE(FitsClearlyBetter(right, turned));
  EXPECT_FALSE(FitsClearlyBetter(turned, right));
  // Of two in a row of equal houses, each has something for it, or little.
  EXPECT_FALSE(FitsClearlyBetter(MatchOf(300, 0.95, 0.97, 0.30), MatchOf(310, 0.94, 0.90, 0.40)));
  EXPECT_FALSE(FitsClearlyBetter(MatchOf(310, 0.95, 0.91, 0.30), MatchOf(300, 0.94, 0.90, 0.33)));
}

TEST(SubmapRegistration, WhatOverlapsInPartAmongOtherCarsMayBeRight) {
  SubmapMatch match = MatchOf(300, 0.9, 0.3, 0.5);
  match.facing = 2.0;
  match.gone = 0.1;
  EXPECT_TRUE(MayBeRight(match, VerificationOptions()));
  match.gone = 0.2;
  EXPECT_FALSE(MayBeRight(match, VerificationOptions()));
  match = MatchOf(300, 0.8, 0.3, 0.5);
  match.looks = 1000;
  match.gone = 0.05;
  EXPECT_FALSE(MayBeRight(match, VerificationOptions()));
  match.gone = 0.0;
  EXPECT_TRUE(MayBeRight(match, VerificationOptions()));
  // Sparse scans have little in common; less is that of any two places.
  match.overlap = 0.3;
  EXPECT_TRUE(MayBeRight(match, VerificationOptions()));
  match.overlap = 0.15;
  EXPECT_FALSE(MayBeRight(match, VerificationOptions()));
}

TEST(SubmapRegistration, ARivalOfHalfATurnLacksFarMore) {
  EXPECT_TRUE(LacksFarLess(MatchOf(300, 0.95, 0.95, 0.3), MatchOf(300, 0.9, 0.8, 0.5)));
  // In rooms of one shape and other furniture neither pose has more than the shell.
  EXPECT_FALSE(LacksFarLess(MatchOf(300, 0.95, 0.84, 0.3), MatchOf(300, 0.9, 0.75, 0.5)));
}

TEST(SubmapRegistration, AFewVansMayBeGoneWhereAllElseAgrees) {
  SubmapMatch match = GoodMatch();
  match.gone = 0.04;
  EXPECT_EQ(RefusalOf(match), "");
  match.overlap = 0.8;
  EXPECT_EQ(RefusalOf(match), "what one has the other saw past");
  match = GoodMatch();
  match.gone = 0.07;
  EXPECT_EQ(RefusalOf(match), "what one has the other saw past");
}

}  // namespace
}  // namespace lamina
