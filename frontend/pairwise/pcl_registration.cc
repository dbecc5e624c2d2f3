#include "frontend/pairwise/pcl_registration.h"

#include <pcl/console/print.h>
#include <pcl/point_types.h>
#include <pcl/registration/gicp.h>
#include <pcl/registration/icp.h>
#include <pcl/registration/ndt.h>

#include <cmath>
#include <type_traits>
#include <utility>

#include "core/base/angle.h"
#include "frontend/pairwise/pcl_search.h"

// Compiled into PCL's library, and heavy to compile again.
extern template class pcl::NormalDistributionsTransform<pcl::PointXYZ, pcl::PointXYZ>;

namespace lamina {
namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using NormalCloud = pcl::PointCloud<pcl::PointNormal>;

// The cloud that a pointer points to.
template <typename Pointer>
using CloudAt = std::remove_const_t<std::remove_reference_t<decltype(*std::declval<Pointer>())>>;

Cloud::Ptr ToPcl(const std::vector<Eigen::Vector3f>& points) {
  auto out = pcl::make_shared<Cloud>();
  out->reserve(points.size());
  for (const Eigen::Vector3f& p : points) out->emplace_back(p.x(), p.y(), p.z());
  return out;
}

NormalCloud::Ptr ToPclWithNormals(const PairwiseCloud& cloud) {
  auto out = pcl::make_shared<NormalCloud>();
  out->reserve(cloud.points.size());
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    pcl::PointNormal p;
    p.getVector3fMap() = cloud.points[i];
    p.getNormalVector3fMap() = cloud.normals.at(i);
    out->push_back(p);
  }
  return out;
}

using Gicp = pcl::GeneralizedIterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>;

Gicp::MatricesVectorPtr ToPclCovariances(const PairwiseCloud& cloud) {
  auto out = pcl::make_shared<Gicp::MatricesVector>();
  out->reserve(cloud.covariances.size());
  for (const Symmetric3& c : cloud.covariances) out->push_back(c.Dense());
  return out;
}

Eigen::Matrix4f ToMatrix(const SE3& T) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = T.R();
  m.topRightCorner<3, 1>() = T.t;
  return m.cast<float>();
}

class PclRegistration final : public PairwiseMethod {
 public:
  PclRegistration(PairwiseKind kind, const PairwiseOptions& options)
      : kind_(kind), options_(options) {
    // PCL prints what it meets; here it is said in the result.
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  }

  void Prepare(PairwiseCloud* cloud) const override {
    if (kind_ == PairwiseKind::kIcpPlane || kind_ == PairwiseKind::kGicp) {
      AddNeighbourhoods(options_.neighbours, cloud);
    }
  }

  PairwiseResult Register(const PairwiseCloud& source, const PairwiseCloud& target,
                          const SE3& initial) const override {
    PairwiseResult result;
    if (kind_ == PairwiseKind::kIcpPlane) {
      pcl::IterativeClosestPointWithNormals<pcl::PointNormal, pcl::PointNormal> icp;
      Align(ToPclWithNormals(source), ToPclWithNormals(target), initial, &icp, &result);
    } else if (kind_ == PairwiseKind::kIcpPoint) {
      pcl::IterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ> icp;
      Align(ToPcl(source.points), ToPcl(target.points), initial, &icp, &result);
    } else if (kind_ == PairwiseKind::kGicp) {
      Gicp gicp;
      gicp.setRotationEpsilon(Radians(options_.min_rotation_step_deg));
      gicp.setMaximumOptimizerIterations(10);
      const auto from = ToPcl(source.points), to = ToPcl(target.points);
      gicp.setInputSource(from);
      gicp.setInputTarget(to);
      gicp.setSourceCovariances(ToPclCovariances(source));
      gicp.setTargetCovariances(ToPclCovariances(target));
      AlignPrepared(initial, &gicp, &result);
    } else {
      pcl::NormalDistributionsTransform<pcl::PointXYZ, pcl::PointXYZ> ndt;
      ndt.setResolution(static_cast<float>(options_.ndt_voxel_m));
      // The longest step of the line search, metres: of the order of the voxel.
      ndt.setStepSize(0.1 * options_.ndt_voxel_m);
      Align(ToPcl(Downsample(source.points, options_.ndt_source_voxel_m)), ToPcl(target.points),
            initial, &ndt, &result);
    }
    return result;
  }

 private:
  template <typename CloudPtr, typename Registration>
  void Align(const CloudPtr& source, const CloudPtr& target, const SE3& initial,
             Registration* registration, PairwiseResult* result) const {
    registration->setInputSource(source);
    registration->setInputTarget(target);
    AlignPrepared(initial, registration, result);
  }

  template <typename Registration>
  void AlignPrepared(const SE3& initial, Registration* registration, PairwiseResult* result) const {
    using Aligned = CloudAt<decltype(registration->getInputSource())>;
    using Target = CloudAt<decltype(registration->getInputTarget())>;
    registration->setSearchMethodTarget(pcl::make_shared<PclSearch<typename Target::PointType>>());
    registration->setMaximumIterations(options_.max_iterations);
    registration->setMaxCorrespondenceDistance(options_.max_distance_m);
    // PCL takes the square of the translation, and the cosine of the rotation. GICP reads the first
    // as the distance itself, and has the second elsewhere.
    const double step = options_.min_translation_step_m;
    const bool is_gicp = kind_ == PairwiseKind::kGicp;
    registration->setTransformationEpsilon(is_gicp ? step : step * step);
    if (!is_gicp) {
      registration->setTransformationRotationEpsilon(
          std::cos(Radians(options_.min_rotation_step_deg)));
    }
    Aligned aligned;
    registration->align(aligned, ToMatrix(initial));
    const Eigen::Matrix4d T = registration->getFinalTransformation().template cast<double>();
    result->good = registration->hasConverged() && T.allFinite();
    if (!result->good) {
      result->reason = "did not converge";
      return;
    }
    result->T_target_source =
        SE3(Eigen::Matrix3d(T.topLeftCorner<3, 3>()), T.topRightCorner<3, 1>());
  }

  PairwiseKind kind_;
  PairwiseOptions options_;
};

}  // namespace

std::unique_ptr<PairwiseMethod> MakePclRegistration(PairwiseKind kind,
                                                    const PairwiseOptions& options) {
  return std::make_unique<PclRegistration>(kind, options);
}

}  // namespace lamina
