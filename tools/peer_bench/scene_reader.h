// Reads a folder of the peer's layout. Every error names file and key or line; keys without effect become
// warnings.
#pragma once

#include <filesystem>

#include "core/result.h"
#include "tools/peer_bench/json_lookup.h"
#include "tools/peer_bench/scene.h"

namespace teres::peer {

Result<Scene> read_scene(const std::filesystem::path& folder);

// Parts, in the order in which read_scene() calls them.
Status read_mesh_and_groups(Scene& scene);
Status read_springs(const JsonObject& springs, Scene& scene);
Status read_tool(const JsonObject& tool, Scene& scene);
Status read_load(const JsonObject& load, Scene& scene);
Status read_points(Scene& scene);
Status read_stored_observations(const std::string& file, Scene& scene);
Status read_filter_settings(const std::string& file, Scene& scene);
Status read_expected(Scene& scene);

/// Nodes of a group of nodes.csv.
Result<std::vector<NodeIndex>> nodes_of(const Scene& scene, const JsonObject& from, JsonObject::Keys keys);

}  // namespace teres::peer
