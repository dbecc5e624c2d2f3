// Nearest neighbours for the methods of PCL.
//
// PCL's own k-d tree asks FLANN, which opens an OpenMP region for every query: a third of the time
// of an ICP whose queries come one by one. nanoflann finds the same neighbours.
//
// Private to frontend/pairwise.
#pragma once

#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <nanoflann.hpp>
#include <stdexcept>
#include <utility>
#include <vector>

namespace lamina {

// Finite points in three dimensions, all of a cloud. Thread-safe for queries.
template <typename PointT>
class PclSearch final : public pcl::search::KdTree<PointT> {
  using Base = pcl::search::KdTree<PointT>;

 public:
  // sorted: nearest first.
  explicit PclSearch(bool sorted = true) : Base(sorted) {}
  PclSearch(const PclSearch&) = delete;
  PclSearch& operator=(const PclSearch&) = delete;

  // Clouds do not change while they are searched: PCL gives the same one again and again.
  void setInputCloud(const typename Base::PointCloudConstPtr& cloud,
                     const pcl::IndicesConstPtr& indices = pcl::IndicesConstPtr()) override {
    if (indices) throw std::logic_error("PclSearch: takes whole clouds");
    if (tree_ && cloud == this->input_) return;
    this->input_ = cloud;
    points_.cloud = cloud.get();
    constexpr std::size_t kLeaf = 15;
    tree_ = std::make_unique<Tree>(3, points_, nanoflann::KDTreeSingleIndexAdaptorParams(kLeaf));
  }

  using Base::nearestKSearch;
  using Base::radiusSearch;

  int nearestKSearch(const PointT& point, int k, pcl::Indices& indices,
                     std::vector<float>& squared_distances) const override {
    indices.resize(static_cast<std::size_t>(k));
    squared_distances.resize(static_cast<std::size_t>(k));
    nanoflann::KNNResultSet<float, int> found(static_cast<std::size_t>(k));
    found.init(indices.data(), squared_distances.data());
    tree_->findNeighbors(found, point.data, nanoflann::SearchParams());
    // Nothing is near a point that is not finite. PCL looks at the first entry all the same.
    if (found.size() == 0) squared_distances[0] = std::numeric_limits<float>::infinity();
    if (found.size() == 0) indices[0] = 0;
    indices.resize(std::max<std::size_t>(1, found.size()));
    squared_distances.resize(indices.size());
    return static_cast<int>(found.size());
  }

  int radiusSearch(const PointT& point, double radius, pcl::Indices& indices,
                   std::vector<float>& squared_distances, unsigned int most = 0) const override {
    std::vector<std::pair<int, float>> found;
    // A bound on the number is one on the nearest.
    const bool sorted = this->sorted_results_ || most > 0;
    tree_->radiusSearch(point.data, static_cast<float>(radius * radius), found,
                        nanoflann::SearchParams(0, 0.0F, sorted));
    if (most > 0 && found.size() > most) found.resize(most);
    indices.clear();
    squared_distances.clear();
    for (const auto& [index, squared_distance] : found) {
      indices.push_back(index);
      squared_distances.push_back(squared_distance);
    }
    return static_cast<int>(found.size());
  }

 private:
  // A cloud as nanoflann wants to see it.
  struct Points {
    const pcl::PointCloud<PointT>* cloud = nullptr;
    std::size_t kdtree_get_point_count() const { return cloud->size(); }
    float kdtree_get_pt(std::size_t i, std::size_t axis) const { return (*cloud)[i].data[axis]; }
    template <typename Box>
    bool kdtree_get_bbox(Box&) const {
      return false;
    }
  };
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>,
                                                   Points, 3, int>;

  Points points_;
  std::unique_ptr<Tree> tree_;
};

}  // namespace lamina
