#include "drivers/camera/realsense.h"

#include <linux/usb/video.h>
#include <linux/uvcvideo.h>

#include <Eigen/Dense>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>

namespace teres {
namespace realsense {
namespace {

constexpr std::size_t kTableHeader = 16;
constexpr std::size_t kAtDataLength = kPacketBytes - 4;

template <class T>
T value_at(std::span<const std::uint8_t> data, std::size_t at) {
    T value;
    std::memcpy(&value, data.data() + at, sizeof value);
    return value;
}

double float_at(std::span<const std::uint8_t> data, std::size_t at) {
    return static_cast<double>(value_at<float>(data, at));
}

std::string hexadecimal(std::span<const std::uint8_t> data) {
    std::string text;
    char two[3];
    for (const std::uint8_t byte : data) {
        std::snprintf(two, sizeof two, "%02x", byte);
        text += two;
    }
    return text;
}

// Header: u16 version (big-endian), u16 type, u32 size of the body, u32, u32 CRC of the body. Gives the whole table,
// without the padding behind it.
Result<std::span<const std::uint8_t>> checked_table(std::span<const std::uint8_t> data, std::uint32_t type,
                                                    std::size_t body_bytes) {
    const std::string name = "calibration table " + std::to_string(type);
    if (data.size() < kTableHeader + body_bytes)
        return host_fault(name + ": " + std::to_string(data.size()) + " bytes, needs " +
                          std::to_string(kTableHeader + body_bytes));
    if (value_at<std::uint16_t>(data, 2) != type)
        return host_fault(name + ": the device sent table " + std::to_string(value_at<std::uint16_t>(data, 2)));
    const std::uint32_t size = value_at<std::uint32_t>(data, 4);
    if (size < body_bytes || size > data.size() - kTableHeader)
        return host_fault(name + ": announces " + std::to_string(size) + " bytes, out of [" +
                          std::to_string(body_bytes) + ", " + std::to_string(data.size() - kTableHeader) + "]");
    // Over all that was sent, or, where the answer tells no length, over the announced body.
    const auto wanted = value_at<std::uint32_t>(data, 12);
    if (crc32(data.subspan(kTableHeader)) != wanted && crc32(data.subspan(kTableHeader, size)) != wanted)
        return host_fault(name + ": wrong CRC");
    return data;
}

bool is_camera(const PinholeModel& m) {
    const auto within = [](double x, double low, double high) { return std::isfinite(x) && x > low && x < high; };
    return within(m.fx_px, 0.1 * m.width_px, 10.0 * m.width_px) &&
           within(m.fy_px, 0.1 * m.height_px, 20.0 * m.height_px) && within(m.cx_px, 0.0, m.width_px) &&
           within(m.cy_px, 0.0, m.height_px);
}

}  // namespace

std::uint32_t crc32(std::span<const std::uint8_t> data) {
    std::uint32_t crc = 0xffffffffu;
    for (const std::uint8_t byte : data) {
        crc ^= byte;
        for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0u);
    }
    return ~crc;
}

Bytes command_packet(std::uint32_t opcode, std::array<std::uint32_t, 4> parameters) {
    Bytes packet(kPacketBytes);
    const std::uint16_t length = 20, magic = 0xcdab;
    std::memcpy(packet.data(), &length, 2);
    std::memcpy(packet.data() + 2, &magic, 2);
    std::memcpy(packet.data() + 4, &opcode, 4);
    std::memcpy(packet.data() + 8, parameters.data(), 16);
    return packet;
}

Result<Bytes> answer_data(std::uint32_t opcode, std::span<const std::uint8_t> packet) {
    char name[32];
    std::snprintf(name, sizeof name, "camera command 0x%02x: ", opcode);
    if (packet.size() < kPacketBytes) return host_fault(std::string(name) + "answer too short");
    const auto echo = value_at<std::int32_t>(packet, 0);
    if (echo != static_cast<std::int32_t>(opcode))
        return host_fault(name + (echo < 0 ? "refused by the firmware, error " + std::to_string(echo)
                                           : "answer to command " + std::to_string(echo)));
    const auto length = value_at<std::uint32_t>(packet, kAtDataLength);
    if (length > kAtDataLength - 4)
        return host_fault(
            name + ("announces " + std::to_string(length) + " bytes, above " + std::to_string(kAtDataLength - 4)));
    const auto data = packet.subspan(4, length > 0 ? length : kAtDataLength - 4);
    return Bytes(data.begin(), data.end());
}

Result<RealSenseIdentity> parse_identity(std::span<const std::uint8_t> data) {
    constexpr std::size_t kFirmware = 12, kSerial = 48, kAsicSerial = 64, kSerialBytes = 6;
    if (data.size() < kAsicSerial + kSerialBytes)
        return host_fault("camera identity: " + std::to_string(data.size()) + " bytes, needs " +
                          std::to_string(kAsicSerial + kSerialBytes));
    RealSenseIdentity identity;
    for (int i = 3; i >= 0; --i)
        identity.firmware += std::to_string(data[kFirmware + static_cast<std::size_t>(i)]) + (i > 0 ? "." : "");
    identity.serial = hexadecimal(data.subspan(kSerial, kSerialBytes));
    identity.asic_serial = hexadecimal(data.subspan(kAsicSerial, kSerialBytes));
    return identity;
}

Result<PinholeModel> parse_depth_table(std::span<const std::uint8_t> data, int width_px, int height_px) {
    struct Size {
        int width_px, height_px;
    };
    // Order of the vendor's rectified resolutions.
    constexpr Size kSizes[] = {{1920, 1080}, {1280, 720}, {640, 480}, {848, 480},  {640, 360},
                               {424, 240},   {320, 240},  {480, 270}, {1280, 800}, {960, 540}};
    constexpr std::size_t kAtModels = 256, kModelBytes = 16;  // fx, fy, cx, cy as floats
    constexpr std::size_t kBody = 496;
    TERES_TRY_ASSIGN(const auto table, checked_table(data, kDepthTable, kBody));
    for (std::size_t i = 0; i < std::size(kSizes); ++i) {
        if (kSizes[i].width_px != width_px || kSizes[i].height_px != height_px) continue;
        const std::size_t at = kAtModels + i * kModelBytes;
        const PinholeModel model{width_px,
                                 height_px,
                                 float_at(table, at),
                                 float_at(table, at + 4),
                                 float_at(table, at + 8),
                                 float_at(table, at + 12),
                                 {}};
        if (!is_camera(model))
            return host_fault("calibration table 25: the entry for " + std::to_string(width_px) + "x" +
                              std::to_string(height_px) + " is no camera");
        return model;
    }
    return invalid_input("calibration table 25 has no entry for " + std::to_string(width_px) + "x" +
                         std::to_string(height_px));
}

Result<double> parse_baseline_m(std::span<const std::uint8_t> data) {
    constexpr std::size_t kAtBaseline = kTableHeader + 4 * 36;  // behind two intrinsics and two rotations
    TERES_TRY_ASSIGN(const auto table, checked_table(data, kDepthTable, 496));
    const double baseline_m = 1e-3 * std::abs(float_at(table, kAtBaseline));  // stored in mm, negative
    if (!(baseline_m > 0.001 && baseline_m < 1.0)) return host_fault("calibration table 25: impossible baseline");
    return baseline_m;
}

Result<ColorCalibration> parse_color_table(std::span<const std::uint8_t> data, int width_px, int height_px) {
    constexpr std::size_t kAtDistortion = kTableHeader + 36, kAtSize = kAtDistortion + 20 + 12 + 12 + 48,
                          kAtRotation = kAtSize + 4 + 36, kAtTranslation = kAtRotation + 36,
                          kBody = kAtTranslation + 12 + 24 - kTableHeader;
    TERES_TRY_ASSIGN(const auto table, checked_table(data, kColorTable, kBody));
    // Normalised to [-1, 1] over the calibrated image; a stream of another aspect ratio is a crop of it.
    double fx = float_at(table, kTableHeader), cx = float_at(table, kTableHeader + 8);
    double fy = float_at(table, kTableHeader + 16), cy = float_at(table, kTableHeader + 20);
    const double calibrated_width = value_at<std::uint16_t>(table, kAtSize),
                 calibrated_height = value_at<std::uint16_t>(table, kAtSize + 2);
    const double aspect = static_cast<double>(height_px) / width_px;
    const double calibrated =
        calibrated_width > 0 && calibrated_height > 0 ? calibrated_height / calibrated_width : 9.0 / 16.0;
    (aspect < calibrated ? fy : fx) *= aspect < calibrated ? calibrated / aspect : aspect / calibrated;
    (aspect < calibrated ? cy : cx) *= aspect < calibrated ? calibrated / aspect : aspect / calibrated;

    ColorCalibration color;
    PinholeModel& model = color.model;
    model = {width_px,
             height_px,
             0.5 * fx * width_px,
             0.5 * fy * height_px,
             0.5 * (1.0 + cx) * width_px,
             0.5 * (1.0 + cy) * height_px,
             {}};
    if (!is_camera(model)) return host_fault("calibration table 32: its values are no camera");
    std::array<double, 5> inverse{};
    for (std::size_t i = 0; i < 5; ++i) inverse[i] = float_at(table, kAtDistortion + 4 * i);
    TERES_TRY_ASSIGN(model.distortion, forward_distortion(model, inverse));
    Eigen::Matrix3d R;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const double r = float_at(table, kAtRotation + 4 * static_cast<std::size_t>(3 * j + i));  // columns
            R(i, j) = r;
            color.pose.rotation[static_cast<std::size_t>(3 * i + j)] = r;
        }
        color.pose.translation_m[static_cast<std::size_t>(i)] =
            -1e-3 * float_at(table, kAtTranslation + 4 * static_cast<std::size_t>(i));  // mm, towards the depth camera
    }
    const Eigen::Vector3d t = Eigen::Map<const Eigen::Vector3d>(color.pose.translation_m.data());
    const bool rigid = R.allFinite() && (R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3 &&
                       R.determinant() > 0.0 && t.allFinite() && t.norm() < 1.0;
    if (!rigid) return host_fault("calibration table 32: its rotation or translation is no pose of a camera");
    return color;
}

Result<std::array<double, 5>> forward_distortion(const PinholeModel& model, const std::array<double, 5>& inverse) {
    std::array<double, 5> forward{};
    for (const double k : inverse)
        if (!std::isfinite(k) || std::abs(k) > 10.0) return host_fault("camera distortion out of [-10, 10]");
    if (inverse == forward) return forward;
    // d(x; k) = (k1 r^2 + k2 r^4 + k3 r^6) x + (2 p1 x y + p2 (r^2 + 2 x^2), ...): linear in k.
    const auto rows = [](double x, double y) {
        const double r2 = x * x + y * y;
        Eigen::Matrix<double, 2, 5> A;
        A << x * r2, x * r2 * r2, 2 * x * y, r2 + 2 * x * x, x * r2 * r2 * r2,  //
            y * r2, y * r2 * r2, r2 + 2 * y * y, 2 * x * y, y * r2 * r2 * r2;
        return A;
    };
    constexpr int kGrid = 21;
    Eigen::Matrix<double, Eigen::Dynamic, 5> A(2 * kGrid * kGrid, 5);
    Eigen::VectorXd b(A.rows());
    for (int i = 0; i < kGrid; ++i) {
        for (int j = 0; j < kGrid; ++j) {
            const Eigen::Vector2d distorted((model.width_px * i / (kGrid - 1.0) - model.cx_px) / model.fx_px,
                                            (model.height_px * j / (kGrid - 1.0) - model.cy_px) / model.fy_px);
            const Eigen::Vector2d undistorted =
                distorted +
                rows(distorted.x(), distorted.y()) * Eigen::Map<const Eigen::Matrix<double, 5, 1>>(inverse.data());
            const int row = 2 * (i * kGrid + j);
            A.middleRows<2>(row) = rows(undistorted.x(), undistorted.y());
            b.segment<2>(row) = distorted - undistorted;
        }
    }
    const Eigen::Matrix<double, 5, 1> k = A.colPivHouseholderQr().solve(b);
    const double worst_px = (A * k - b).cwiseAbs().maxCoeff() * std::max(model.fx_px, model.fy_px);
    if (!(worst_px < 1.0))
        return host_fault("camera distortion cannot be inverted over the image: " + std::to_string(worst_px) +
                          " px left");
    Eigen::Map<Eigen::Matrix<double, 5, 1>>(forward.data()) = k;
    return forward;
}

Result<double> parse_depth_unit(std::span<const std::uint8_t> data) {
    if (data.size() < 20) return host_fault("depth control: " + std::to_string(data.size()) + " bytes, needs 20");
    const double unit_m = 1e-6 * value_at<std::uint32_t>(data, 0);  // micrometres
    if (unit_m < 1e-6 || unit_m > 0.1)
        return host_fault("depth control: unit of " + std::to_string(unit_m) + " m is out of [1e-6, 0.1]");
    return unit_m;
}

}  // namespace realsense

namespace {
constexpr std::uint8_t kUnit = 3, kCommandSelector = 1, kTemperatureSelector = 9;
}

Result<RealSense> RealSense::attach(SystemCalls& calls, int fd) {
    RealSense camera(calls, fd);
    std::uint8_t length[2] = {};
    TERES_TRY(camera.query(kCommandSelector, UVC_GET_LEN, length));
    const int size = length[0] | length[1] << 8;
    if (size != static_cast<int>(realsense::kPacketBytes))
        return invalid_input("extension unit 3 takes " + std::to_string(size) + " bytes, a D4xx 1024");
    return camera;
}

Status RealSense::query(std::uint8_t selector, std::uint8_t what, std::span<std::uint8_t> data) {
    uvc_xu_control_query request{kUnit, selector, what, static_cast<std::uint16_t>(data.size()), data.data()};
    int result = 0;
    do result = calls_->ioctl(fd_, UVCIOC_CTRL_QUERY, &request);
    while (result < 0 && errno == EINTR);
    if (result >= 0) return {};
    const bool absent = errno == ENOENT || errno == ENOTTY || errno == EINVAL;
    const std::string text = "extension unit 3, selector " + std::to_string(selector) + ": " + std::strerror(errno);
    return absent ? Status(invalid_input(text)) : Status(host_fault(text));
}

Result<realsense::Bytes> RealSense::command(std::uint32_t opcode, std::array<std::uint32_t, 4> parameters) {
    realsense::Bytes packet = realsense::command_packet(opcode, parameters);
    TERES_TRY(query(kCommandSelector, UVC_SET_CUR, packet));
    packet.assign(realsense::kPacketBytes, 0);
    TERES_TRY(query(kCommandSelector, UVC_GET_CUR, packet));
    return realsense::answer_data(opcode, packet);
}

Result<RealSenseIdentity> RealSense::identity() {
    TERES_TRY_ASSIGN(const auto data, command(realsense::kIdentity));
    return realsense::parse_identity(data);
}

Result<PinholeModel> RealSense::depth_model(int width_px, int height_px) {
    TERES_TRY_ASSIGN(const auto data, command(realsense::kCalibration, {realsense::kDepthTable}));
    return realsense::parse_depth_table(data, width_px, height_px);
}

Result<double> RealSense::baseline_m() {
    TERES_TRY_ASSIGN(const auto data, command(realsense::kCalibration, {realsense::kDepthTable}));
    return realsense::parse_baseline_m(data);
}

Result<ColorCalibration> RealSense::color(int width_px, int height_px) {
    TERES_TRY_ASSIGN(const auto data, command(realsense::kCalibration, {realsense::kColorTable}));
    return realsense::parse_color_table(data, width_px, height_px);
}

Result<double> RealSense::depth_unit_m() {
    TERES_TRY_ASSIGN(const auto data, command(realsense::kAdvancedValue, {realsense::kDepthControl}));
    return realsense::parse_depth_unit(data);
}

Result<double> RealSense::temperature_c() {
    std::uint8_t data[4] = {};  // projector valid, chip valid, projector [°C], chip [°C]
    TERES_TRY(query(kTemperatureSelector, UVC_GET_CUR, data));
    if (data[0] == 0 && data[1] == 0) return not_usable("the camera measures no temperature now");
    return static_cast<double>(static_cast<std::int8_t>(data[0] != 0 ? data[2] : data[3]));
}

Status RealSense::hardware_reset() {
    realsense::Bytes packet = realsense::command_packet(realsense::kHardwareReset);
    return query(kCommandSelector, UVC_SET_CUR, packet);  // it leaves the bus and answers no more
}

}  // namespace teres
