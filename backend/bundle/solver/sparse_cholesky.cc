#include "backend/bundle/solver/sparse_cholesky.h"

#include <suitesparse/cholmod.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <mutex>
#include <vector>

namespace lamina {
namespace {

// METIS draws from the C library's random numbers, which all threads share: one order at a time,
// each from the same seed.
std::mutex& OrderMutex() {
  static std::mutex mutex;
  return mutex;
}

// The upper triangle of a symmetric matrix in compressed columns, as CHOLMOD sees it in place.
cholmod_sparse View(std::size_t size, int* outer, int* inner, double* values) {
  cholmod_sparse view = {};
  view.nrow = view.ncol = size;
  view.nzmax = static_cast<std::size_t>(outer[size]);
  view.p = outer;
  view.i = inner;
  view.x = values;
  view.stype = 1;
  view.itype = CHOLMOD_INT;
  view.xtype = values != nullptr ? CHOLMOD_REAL : CHOLMOD_PATTERN;
  view.dtype = CHOLMOD_DOUBLE;
  view.sorted = 1;
  view.packed = 1;
  return view;
}

}  // namespace

struct SparseCholesky::Impl {
  cholmod_common common;
  cholmod_factor* factor = nullptr;
  std::vector<int> order;  // of the unknowns: old index of each place

  Impl() {
    cholmod_start(&common);
    common.print = 0;
    common.error_handler = nullptr;
    common.supernodal = CHOLMOD_SUPERNODAL;
    common.final_ll = 1;
    common.quick_return_if_not_posdef = 1;
  }
  ~Impl() {
    FreeFactor();
    cholmod_finish(&common);
  }
  void FreeFactor() {
    if (factor != nullptr) cholmod_free_factor(&factor, &common);
  }
};

SparseCholesky::SparseCholesky() : impl_(std::make_unique<Impl>()) {}
SparseCholesky::~SparseCholesky() = default;

double SparseCholesky::Order(const BlockPattern& pattern) {
  constexpr double kNone = 2.0;
  cholmod_common& common = impl_->common;
  const std::size_t frames = pattern.frames();
  std::vector<int> outer{0}, inner;
  for (std::size_t f = 0; f < frames; ++f) {
    inner.insert(inner.end(), pattern.partners(f).begin(), pattern.partners(f).end());
    outer.push_back(static_cast<int>(inner.size()));
  }
  cholmod_sparse graph = View(frames, outer.data(), inner.data(), nullptr);
  common.nmethods = 2;
  common.method[0].ordering = CHOLMOD_AMD;
  common.method[1].ordering = CHOLMOD_METIS;
  cholmod_factor* symbolic = nullptr;
  {
    const std::lock_guard<std::mutex> lock(OrderMutex());
    symbolic = cholmod_analyze(&graph, &common);
  }
  if (symbolic == nullptr) return kNone;
  impl_->order.clear();
  for (std::size_t i = 0; i < frames; ++i) {
    const int frame = static_cast<const int*>(symbolic->Perm)[i];
    for (int c = 0; c < 6; ++c) impl_->order.push_back(6 * frame + c);
  }
  cholmod_free_factor(&symbolic, &common);
  impl_->FreeFactor();
  return 3.0 * common.fl / std::pow(static_cast<double>(frames), 3);
}

bool SparseCholesky::Factorise(const Eigen::SparseMatrix<double>& upper) {
  cholmod_common& common = impl_->common;
  // CHOLMOD only reads through these pointers.
  cholmod_sparse H =
      View(static_cast<std::size_t>(upper.cols()), const_cast<int*>(upper.outerIndexPtr()),
           const_cast<int*>(upper.innerIndexPtr()), const_cast<double*>(upper.valuePtr()));
  if (impl_->factor == nullptr) {
    common.nmethods = 1;
    common.method[0].ordering = CHOLMOD_GIVEN;
    impl_->factor = cholmod_analyze_p(&H, impl_->order.data(), nullptr, 0, &common);
    if (impl_->factor == nullptr) return false;
  }
  const bool done = cholmod_factorize(&H, impl_->factor, &common) != 0;
  return done && common.status == CHOLMOD_OK && impl_->factor->minor == impl_->factor->n;
}

bool SparseCholesky::FactoriseDamped(const BlockPattern& pattern, const HeldDirections& held,
                                     const Eigen::VectorXd& damping,
                                     Eigen::SparseMatrix<double>* H) {
  // Entry (r, c), r <= c, of the block of frame f on the diagonal.
  const auto entry = [&](std::size_t f, int r, int c) -> double& {
    return BlockPattern::Entry(f, pattern.own(f), r, c, H);
  };
  const auto for_each = [&](const auto& visit) {
    for (std::size_t f = 0; f < pattern.frames(); ++f) {
      for (int c = 0; c < 6; ++c) {
        for (int r = 0; r <= c; ++r) visit(&entry(f, r, c));
      }
    }
  };
  std::vector<double> before;
  for_each([&](const double* value) { before.push_back(*value); });
  for (Eigen::Index i = 0; i < damping.size(); ++i) {
    const int c = static_cast<int>(i % 6);
    entry(static_cast<std::size_t>(i / 6), c, c) += damping(i);
  }
  held.ForEachDamping(damping, [&](std::size_t f, const Matrix6d& change) {
    for (int c = 0; c < 6; ++c) {
      for (int r = 0; r <= c; ++r) entry(f, r, c) += change(r, c);
    }
  });
  const bool factorised = Factorise(*H);
  auto value = before.begin();
  for_each([&](double* to) { *to = *value++; });
  return factorised;
}

Eigen::VectorXd SparseCholesky::Solve(const Eigen::VectorXd& right_side) {
  cholmod_dense b = {};
  b.nrow = b.nzmax = b.d = static_cast<std::size_t>(right_side.size());
  b.ncol = 1;
  b.x = const_cast<double*>(right_side.data());
  b.xtype = CHOLMOD_REAL;
  b.dtype = CHOLMOD_DOUBLE;
  cholmod_dense* x = cholmod_solve(CHOLMOD_A, impl_->factor, &b, &impl_->common);
  if (x == nullptr) return Eigen::VectorXd::Constant(right_side.size(), std::nan(""));
  const Eigen::VectorXd solution =
      Eigen::Map<const Eigen::VectorXd>(static_cast<const double*>(x->x), right_side.size());
  cholmod_free_dense(&x, &impl_->common);
  return solution;
}

}  // namespace lamina
