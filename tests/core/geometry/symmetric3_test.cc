#include "core/geometry/symmetric3.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <vector>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

using Matrix3l = Eigen::Matrix<long double, 3, 3>;

// U diag(l) U' in extended precision, rounded once.
Symmetric3 WithSpectrum(const Eigen::Vector3d& l, Draws* draws) {
  Matrix3l u = draws->Pose(1.0).R().cast<long double>();
  u.col(0).normalize();
  u.col(1) = (u.col(1) - u.col(0) * u.col(0).dot(u.col(1))).normalized();
  u.col(2) = u.col(0).cross(u.col(1));
  const Matrix3l m = u * l.cast<long double>().asDiagonal() * u.transpose();
  return Symmetric3::FromDense(m.cast<double>());
}

// A u = l u and u'u = I, to `relative` of the largest eigenvalue; l descends.
void ExpectDecomposition(const Symmetric3& s, double relative) {
  const Eigen3 e = EigenDecompose(s);
  const double scale = s.Dense().norm();
  EXPECT_LE((s.Dense() * e.u - e.u * e.l.asDiagonal()).norm(), relative * scale);
  EXPECT_LE((e.u.transpose() * e.u - Eigen::Matrix3d::Identity()).norm(), relative);
  EXPECT_GE(e.l(0), e.l(1));
  EXPECT_GE(e.l(1), e.l(2));
}

TEST(Symmetric3, DecomposesRandomMatrices) {
  Draws draws(1);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Matrix3d a =
        (Eigen::Matrix3d() << draws.InCube(1.0), draws.InCube(1.0), draws.InCube(1.0)).finished();
    const double scale = std::pow(10.0, draws.Uniform(-12.0, 12.0));
    ExpectDecomposition(Symmetric3::FromDense(scale * (a + a.transpose())), 1e-12);
  }
}

TEST(Symmetric3, SmallEigenvaluesKeepTheirDigits) {
  Draws draws(2);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d l(1.0, 1e-3, 1e-12);
    const Symmetric3 s = WithSpectrum(l, &draws);
    ExpectDecomposition(s, 1e-12);
    const Eigen3 e = EigenDecompose(s);
    EXPECT_NEAR(e.l(0), 1.0, 1e-14);
    EXPECT_NEAR(e.l(1), 1e-3, 1e-15);
    // Rounding the entries to double alone moves it by some 1e-16.
    EXPECT_NEAR(e.l(2), 1e-12, 1e-15);
  }
}

TEST(Symmetric3, ManyAtOnceHaveTheBitsOfEachAlone) {
  Draws draws(5);
  for (std::size_t count = 0; count < 40; ++count) {
    std::vector<Symmetric3> s(count);
    for (std::size_t i = 0; i < count; ++i) {
      // Some are of few points, some diagonal, some zero.
      for (int k = draws.Integer(0, 4); k > 0; --k) s[i].AddOuter(1.0, draws.InCube(1.0));
      if (i % 5 == 0) s[i] = {s[i].xx, 0.0, 0.0, s[i].yy, 0.0, s[i].zz};
    }
    std::vector<Eigen3> together(count);
    EigenDecompose(s.data(), count, together.data());
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen3 alone = EigenDecompose(s[i]);
      EXPECT_EQ(alone.l, together[i].l);
      EXPECT_EQ(alone.u, together[i].u);
    }
  }
}

TEST(Symmetric3, AgreesWithExtendedPrecision) {
  Draws draws(3);
  for (int i = 0; i < 500; ++i) {
    const Symmetric3 s = WithSpectrum({1.0, draws.Uniform(0.0, 1.0), 1e-8}, &draws);
    const Eigen::SelfAdjointEigenSolver<Matrix3l> solver(s.Dense().cast<long double>());
    const Eigen3 e = EigenDecompose(s);
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(e.l(k), static_cast<double>(solver.eigenvalues()(2 - k)), 1e-15 * (k < 2 ? 5 : 1))
          << "eigenvalue " << k;
    }
  }
}

TEST(Symmetric3, ZeroDiagonalAndRepeatedEigenvalues) {
  ExpectDecomposition(Symmetric3(), 1e-15);
  EXPECT_EQ(EigenDecompose(Symmetric3()).l.norm(), 0.0);
  Draws draws(4);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d d = draws.InCube(1.0);
    const Symmetric3 diagonal = {d.x(), 0.0, 0.0, d.y(), 0.0, d.z()};
    ExpectDecomposition(diagonal, 1e-15);
    EXPECT_EQ(EigenDecompose(diagonal).l(0), d.maxCoeff());
    EXPECT_EQ(EigenDecompose(diagonal).l(2), d.minCoeff());
    ExpectDecomposition(WithSpectrum({2.0, 2.0, 2.0}, &draws), 1e-14);
    ExpectDecomposition(WithSpectrum({2.0, 2.0, 1e-9}, &draws), 1e-14);
    ExpectDecomposition(WithSpectrum({2.0, 1e-9, 1e-9}, &draws), 1e-14);
    ExpectDecomposition(WithSpectrum({2.0, 0.0, 0.0}, &draws), 1e-14);
  }
}

TEST(Symmetric3, OperationsMatchDenseMatrices) {
  Draws draws(5);
  for (int i = 0; i < 500; ++i) {
    const Symmetric3 s = WithSpectrum(draws.InCube(1.0), &draws);
    const Eigen::Matrix3d R = draws.Pose(1.0).R();
    const Eigen::Vector3d a = draws.InCube(1.0);
    EXPECT_LT((s.Rotated(R).Dense() - R * s.Dense() * R.transpose()).norm(), 1e-14);
    EXPECT_LT((s * a - s.Dense() * a).norm(), 1e-15);
    EXPECT_NEAR(s.Trace(), s.Dense().trace(), 1e-15);
    Symmetric3 sum = s * 2.0;
    sum.AddOuter(0.7, a);
    EXPECT_LT((sum.Dense() - 2.0 * s.Dense() - 0.7 * a * a.transpose()).norm(), 1e-14);
  }
}

}  // namespace
}  // namespace lamina
