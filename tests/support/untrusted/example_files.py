"""Sound examples of every kind of file that Passerby reads, small, as bytes."""

# ruff: noqa: E501 (tables of text that is broken, or read, as it stands)

from __future__ import annotations

import io
import json
import pickle
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.core.observations import BODY_17, Boxes, Keypoints
from passerby.interchange.coco import write_keypoints
from passerby.interchange.formats import Export, export
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.video_writer import VideoWriter
from support.scenes.handmade_rigs import CENTRE, LOOKING_NORTH, MATRIX, SIZE, TRANSLATION

Files = Mapping[str, bytes]
"""Name below a folder -> content; the first is the one that a reader is given, where that is not the folder."""
SCENE = """# two cameras
[scene]
name = "court"
fps = 25
[cameras.A]
intrinsics = "rig.toml"
tracks = "A.txt"
keypoints = "A.json"
embeddings = "A.npz"
[cameras.B]
intrinsics = "rig.toml"
detections = "B.txt"
fps = 12.5
[association]
mode = "combined"
max_offset_s = 2
[perception]
detector = "background"
tiles = [2, 1]
[solver]
reference = "A"
[scale]
person_height_m = 1.7
[[scale.lengths]]
metres = 3.6
points = { A = [[1, 2], [30, 40]], B = [[5, 6], [70, 80]] }
[[scale.distances]]
between = ["A", "B"]
metres = 7.5
[[scale.camera_heights]]
camera = "B"
metres = 2.5
[world]
points = "points.csv"
scale = true
"""
POINTS = "camera,u,v,x,y,z,point,sd_m\nA,10,20,0,0,0,corner,0.05\nB,30.5,40,0,0,0,corner,0.05\nA,50,60,4,0,1.5,post,\n"
POINTS_TOML = '[[points]]\ncamera = "A"\nu = 10.5\nv = 20\nx = 0\ny = 1.5\npoint = "p"\n[[points]]\ncamera = "B"\nu = 1\nv = 2\nx = 3\ny = 4\nsd_m = 0.1\n'
POSITIONS = "camera,lat,lon,alt,sd_m\nA,48.1,11.5,520,2\nB,48.1001,11.5002,521,2\n"
POSITIONS_TOML = '[[positions]]\ncamera = "A"\nx = 0\ny = 1.5\nz = 3\n[[positions]]\ncamera = "B"\nx = 5\ny = 6\n'
TRAJECTORIES = (
    "time_s,frame,id,x_m,y_m,z_m,sigma_m,cameras\n0.0000,1,1,0.5,1.5,0.86,0.03,2\n0.0400,2,1,0.55,1.5,0.86,0.03,2\n"
    "0.0800,3,1,0.6,1.5,0.86,,1\n0.0400,2,4,5.55,1.5,0.86,0.03,2\n"
)
GROUND = "frame,id,x_m,y_m,z_m\n1,1,0.5,1.5,0\n2,1,0.6,1.5,0\n2,2,-3,2e0,0\n"
VATIC = '0 10 20 50 120 0 0 0 0 "PERSON"\n0 12 20 52 120 1 0 1 0 "PERSON"\n3 100 20 150 120 1 1 0 0 "PERSON"\n'
CVML = (
    '<?xml version="1.0"?>\n<dataset name="a">\n<frame number="0"><objectlist><object id="1"><box h="80" w="30" xc="50.5" '
    'yc="60"/></object><object id="2"><box h="81" w="31" xc="150" yc="61"/></object></objectlist></frame>\n'
    '<frame number="1"><objectlist/></frame>\n</dataset>\n'
)
MOT_TRUTH = "1,1,10,20,30,80,1,0.5,1.5,0\n2,1,11,20,30,80,1,0.6,1.5,0\n1,2,-1,-1,-1,-1,1,3,4,0\n2,2,60,20,31,82,0\n"
GRID = "comment\n3 2 30 44 25 0 75\n10 -1\n11 -2\n12 400\n"
SEQUENCE = "[Sequence]\nname=MOT-1\nimDir=img1\nframeRate=30\nseqLength=2\nimWidth=64\nimHeight=48\nimExt=.jpg\n"
PEDESTRIANS = "1,1,10,20,30,80,1,1,1\n2,1,11,20,30,80,1,1,0.4\n1,2,60,20,31,82,1,7,1\n"
LOG = "epoch,step,learning_rate,loss,identity_loss,triplet_loss,rank_1,map\n1,10,0.001,5.5,4.0,1.5,,\n2,20,0.001,4.5,3.5,1.0,0.5,0.4\n"
MSMT17 = "0000/0000_000_01_0303morning_0015_0.jpg 0\n0000/0000_001_02_0303noon_0015_1.jpg 0\n0001/0001_000_03_0303morning_1_0.jpg 1\n"
XML_STORAGE = (
    '<?xml version="1.0"?>\n<opencv_storage>\n<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>'
    "<data>\n900. 0. 320. 0. 900. 240. 0. 0. 1.</data></camera_matrix>\n<rvec>0.1 0.2 0.3</rvec>\n</opencv_storage>\n"
)
PANOPTIC = {
    "cameras": [
        {"name": f"00_0{n}", "type": "hd", "resolution": [640, 480], "panel": 0, "node": n,
         "K": [[700, 0, 320], [0, 700, 240], [0, 0, 1]], "distCoef": [-0.2, 0.1, 0, 0, 0],
         "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [[10.0 * n], [0], [300]]}
        for n in range(2)
    ]
}  # fmt: skip
TSAI = """<?xml version="1.0" encoding="UTF-8"?>
<Camera name="c0">
 <Geometry width="720" height="576" ncx="0" nfx="0" dx="0" dy="0" dpx="0.023" dpy="0.023"/>
 <Intrinsic focal="20.2" kappa1="5.7e-4" cx="366.5" cy="305.8" sx="1.08"/>
 <Extrinsic tx="-4.8" ty="2.25" tz="35.3" rx="1.75" ry="0.42" rz="0.05"/>
</Camera>
"""
NETWORK = 'role = "embedder"\noutput = "embedding"\nlicence = "MIT"\n[input]\ncolour = "rgb"\nscale = 0.0039\nmean = [0.5, 0.5, 0.5]\nstd = [0.2, 0.2, 0.2]\nfit = "stretch"\n'


@cache
def rig(bent: bool = True) -> Rig:
    """Two cameras with poses, the first with a distorted lens unless `bent` is False, and with a sigma."""
    lens = Lens(
        (640, 480), np.array([[700.0, 0, 320], [0, 710, 240], [0, 0, 1]]), np.array([-0.2, 0.1, 1e-3, -1e-3, 0.01]) * bent
    )
    plain = Lens((640, 480), np.array([[800.0, 0, 319.5], [0, 800, 239.5], [0, 0, 1]]), np.zeros(0))
    across = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    along = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    sigma = PoseSigma(0.02, 0.3, np.eye(6) * 1e-4)
    return Rig((Camera("A", lens, Pose.from_centre(across, np.array([0.0, -5, 3])), sigma),
                Camera("B", plain, Pose.from_centre(along, np.array([-6.0, 1, 2.5])))), "accepted")  # fmt: skip


def boxes(identity: int = 1) -> Boxes:
    frame, who = np.repeat(np.arange(1, 5), 2), np.tile([identity, identity + 1], 4)
    ltwh = np.column_stack([40.0 * who + frame, 100.0 + frame, np.full(8, 31.5), np.full(8, 90.0)])
    return Boxes(frame, who, ltwh, np.full(8, 0.9))


def joints() -> Keypoints:
    xy = np.arange(3 * 17 * 2, dtype=np.float64).reshape(3, 17, 2) + 50
    return Keypoints(np.arange(1, 4), np.ones(3, dtype=np.int64), xy, np.full((3, 17), 0.75))


def files_of(folder: Path) -> Files:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def written(name: str, write: object) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)  # type: ignore[operator]
        return (Path(folder) / name).read_bytes()


# Files of motion capture whose camera has points at pixels that can be told by hand.
BENT = (-0.1, 0.02, 0.001, -0.002, 0.003)
ROWS = [*MATRIX.tolist(), *np.column_stack([LOOKING_NORTH, 1000 * np.array(TRANSLATION)]).tolist(), [0, 0, 0, 1]]
LINES = [" ".join(map(str, row)) for row in ROWS]
BIOCV = "\n".join([*map(str, SIZE), *LINES[:3], "", *LINES[3:], "", "0 0 0 0 0", ""])


def calibio_camera(model, **parameters):
    values = {"f": 1000.0, "ar": 1.1, "cx": 960.0, "cy": 540.0} | parameters
    size = {"CameraModelBase": {"imageSize": dict(zip(("width", "height"), SIZE, strict=True))}}
    data = {"parameters": {key: {"val": value} for key, value in values.items()}, "CameraModelCRT": size}
    turn, place = {"rx": np.pi / 2, "ry": 0.0, "rz": 0.0}, dict(zip("xyz", TRANSLATION, strict=True))
    return {"model": model | {"ptr_wrapper": {"id": 1, "data": data}}, "transform": {"rotation": turn, "translation": place}}


# The second camera refers to the model of the first by its number.
NAMED = {"polymorphic_id": 0x80000001, "polymorphic_name": "libCalib::CameraModelOpenCV"}
COEFFICIENTS = dict(zip(("k1", "k2", "p1", "p2", "k3"), BENT, strict=True))
CALIBIO_CAMERAS = [calibio_camera(NAMED), calibio_camera({"polymorphic_id": 1}, **COEFFICIENTS)]
CALIBIO = json.dumps({"Calibration": {"cameras": CALIBIO_CAMERAS, "poses": [1]}})
# In Motive's world (y up) this world's (x, y, z) is (x, z, -y): the camera is at (4, 2.5, 3) and looks along -z.
MOTIVE_LENS = 'HorizontalFocalLength="1000" VerticalFocalLength="1100" LensCenterX="960" LensCenterY="540"'
MOTIVE_BENT = f'{MOTIVE_LENS} k1="-0.1" k2="0.02" k3="0.003" TangentialX="0.001" TangentialY="-0.002"'
MOTIVE = (
    '<?xml version="1.0" encoding="UTF-16LE"?><calibrationProfile><Calibration><Cameras><Camera Serial="M7">'
    '<Properties CameraID="1"/><Attributes ImagerPixelWidth="1920" ImagerPixelHeight="1080"/>'
    f'<IntrinsicStandardCameraModel {MOTIVE_LENS}/><Extrinsic X="4" Y="2.5" Z="3" OrientMatrix0="1" OrientMatrix1="0" '
    'OrientMatrix2="0" OrientMatrix3="0" OrientMatrix4="1" OrientMatrix5="0" OrientMatrix6="0" OrientMatrix7="0" '
    'OrientMatrix8="1"/></Camera></Cameras></Calibration></calibrationProfile>'
)
# Level, 2 m above the floor at x = 4 m, looking along the world's -x: its right is the world's +y, its backward +x.
QUALISYS_CAMERA = (
    '<camera active="1" calibrated="true" avg-residual="0.5" serial="26580" model="Miqus Video" viewrotation="0">'
    '<fov_marker left="0" top="0" right="1919" bottom="1087"/><fov_video left="0" top="0" right="1919" bottom="1087"/>'
    '<fov_video_max left="0" top="0" right="1919" bottom="1087"/>'
    '<transform x="4000" y="0" z="2000" r11="0" r12="1" r13="0" r21="0" r22="0" r23="1" r31="1" r32="0" r33="0"/>'
    '<intrinsic focallength="9.3" sensorMinU="0" sensorMaxU="122879" sensorMinV="0" sensorMaxV="69631" focalLengthU="102400" '
    'focalLengthV="102400" centerPointU="61408" centerPointV="34784" skew="0" radialDistortion1="0" radialDistortion2="0" '
    'radialDistortion3="0" tangentalDistortion1="0" tangentalDistortion2="0"/></camera>'
)
QUALISYS = f'<?xml version="1.0"?><calibration source="x"><cameras>{QUALISYS_CAMERA}</cameras></calibration>'
KEYFRAME = (
    f'<KeyFrame FRAME="0" FOCAL_LENGTH="1000" PRINCIPAL_POINT="960 540" POSITION="{" ".join(str(1000 * x) for x in CENTRE)}" '
    f'ORIENTATION="{" ".join(map(repr, Rotation.from_matrix(LOOKING_NORTH).as_quat().tolist()))}"/>'
)
VICON = (
    '<?xml version="1.0"?><Cameras><Camera DEVICEID="21" NAME="" SENSOR_SIZE="1920 1080" PIXEL_ASPECT_RATIO="1" SKEW="0">'
    f"<KeyFrames>{KEYFRAME}</KeyFrames></Camera></Cameras>"
)
OPENCAP = {
    "distortion": np.zeros((1, 5)), "intrinsicMat": MATRIX, "imageSize": np.array([[float(SIZE[1])], [float(SIZE[0])]]),
    "rotation": LOOKING_NORTH, "translation": 1000 * np.reshape(TRANSLATION, (3, 1)),
    "rotation_EulerAngles": np.array([[np.pi / 2], [0], [0]]),
}  # fmt: skip

BY_HAND = {
    "biocv": ("00.calib", BIOCV), "calibio": ("calib.json", CALIBIO), "motive": ("lab.mcal", MOTIVE),
    "opencap": ("cam.pickle", OPENCAP), "qualisys": ("Lab.qca.txt", QUALISYS), "vicon": ("lab.xcp", VICON),
}  # fmt: skip
"""Format -> name and content of its file."""
READ_ONLY: dict[str, str | bytes] = {
    "tsai": TSAI, "calibio": CALIBIO, "biocv": BIOCV.replace("0 0 0 0 0", "-0.1 0.02 0.001 -0.002 0.003"),
    "motive": MOTIVE.replace(MOTIVE_LENS, MOTIVE_BENT).encode("utf-16"),
    "opencap": pickle.dumps(OPENCAP | {"distortion": np.array([BENT])}, protocol=4),
    "qualisys": QUALISYS.replace('radialDistortion1="0"', 'radialDistortion1="-0.05"'),
    "vicon": VICON.replace("<KeyFrame ", '<KeyFrame VICON_RADIAL2="Vicon3Parameter 955 548 -1e-08 1e-15 0" '),
}  # fmt: skip
"""Formats that are not written."""


def rig_file() -> bytes:
    return written("rig.toml", lambda path: write_rig(path, rig()))


def boxes_file() -> bytes:
    return written("A.txt", lambda path: write_boxes(path, boxes()))


def joints_file() -> bytes:
    return written("A.json", lambda path: write_keypoints(path, joints()))


def looks_file(rows: int = 8) -> bytes:
    held = io.BytesIO()
    np.savez(held, embeddings=np.eye(rows, 4, dtype=np.float32) + 0.1, frame=np.repeat(np.arange(1, 5), 2)[:rows])
    return held.getvalue()


def looks_packed() -> bytes:
    """Embeddings in a compressed archive."""
    held = io.BytesIO()
    np.savez_compressed(held, embeddings=np.eye(8, 4, dtype=np.float64))
    return held.getvalue()


def scene_folder() -> Files:
    """A scene file and all that it names."""
    return {
        "scene.toml": SCENE.encode(), "rig.toml": rig_file(), "A.txt": boxes_file(), "A.json": joints_file(), "A.npz": looks_file(),
        "B.txt": boxes_file(), "points.csv": POINTS.encode(),
    }  # fmt: skip


def output_folder() -> Files:
    """What a calibration leaves, as far as it is read again."""
    cameras = [{"name": name, "boxes": 8, "fps": 25.0, "time_offset_s": 0.1} for name in rig().names]
    scene = {"scene": {"fps": 25.0}, "scale": {"person_height_m": 1.72}}
    report = {"verdict": "accepted", "reasons": [], "cameras": cameras, "scene": scene, "association": {"mode": "given"}}
    return {
        "calibration.json": json.dumps(report).encode(), "rig.toml": rig_file(), "tracks/A.txt": boxes_file(),
        "tracks/B.txt": boxes_file(),
    }  # fmt: skip


def exported(name: str, target: str) -> Files:
    """The rig in a format, in one file of that name, or in a folder where it is empty."""
    if name in READ_ONLY:
        content = READ_ONLY[name]
        return {target: content if isinstance(content, bytes) else content.encode()}
    with tempfile.TemporaryDirectory() as folder:
        export(Export(rig(bent=name not in ("tsai",))), name, Path(folder) / (target or "rig"), lossy=True)
        return files_of(Path(folder) / ("" if target else "rig"))


def openpose() -> Files:
    values = {1: [100.5, 50, 0.9], -1: [7, 8, 0.5]}
    people = [{"person_id": [who], "pose_keypoints_2d": value * 25} for who, value in values.items()]
    return {f"cam_{number:012d}_keypoints.json": json.dumps({"version": 1.3, "people": people}).encode() for number in range(3)}


def alphapose() -> Files:
    people = [
        {"image_id": f"{number}.jpg", "category_id": 1, "keypoints": [100.5, 50, 0.9] * 17, "score": 2.5, "box": [1, 2, 30, 80.5],
         "idx": who}
        for number in range(3) for who in (1, 2)
    ]  # fmt: skip
    return {"alphapose-results.json": json.dumps(people).encode()}


def coco_people() -> Files:
    """Annotations with boxes, joints, crowds and other categories."""
    images = [{"id": 7 + number, "file_name": f"cam1_{number:06d}.jpg"} for number in range(1, 4)]
    categories = [{"id": 1, "name": "person", "keypoints": list(BODY_17)}, {"id": 2, "name": "bag"}]
    annotations = [
        {"id": 1, "image_id": 8, "category_id": 1, "bbox": [1, 2, 30, 80], "keypoints": [10, 20, 2] * 17, "track_id": 1, "score": 0.9},
        {"id": 2, "image_id": 9, "category_id": 1, "bbox": [1, 2, 30, 80], "attributes": {"track_id": 4}, "iscrowd": 0},
        {"id": 3, "image_id": 9, "category_id": 1, "bbox": [5, 2, 30, 80], "iscrowd": 1},
        {"id": 4, "image_id": 10, "category_id": 2, "bbox": [5, 2, 30, 80]},
    ]  # fmt: skip
    return {"coco.json": json.dumps({"images": images, "categories": categories, "annotations": annotations}).encode()}


def coco_results() -> Files:
    results = [{"image_id": number, "category_id": 1, "bbox": [1, 2, 30, 80], "score": 0.5} for number in range(4)]
    return {"results.json": json.dumps(results).encode()}


def opencv_lens(suffix: str) -> Files:
    """One camera as OpenCV's calibration sample writes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"lens{suffix}"
        lens, storage = rig()["A"].lens, cv2.FileStorage(str(path), cv2.FileStorage_WRITE)
        for key, value in (
            ("image_width", 640), ("image_height", 480), ("camera_matrix", np.array(lens.matrix)),
            ("distortion_coefficients", np.array(lens.distortions)[:, None]), ("camera_model", "pinhole"),
        ):  # fmt: skip
            storage.write(key, value)
        storage.release()
        return {path.name: path.read_bytes()}


def plain_lens() -> Files:
    """A lens as scripts write it."""
    K = [[700, 0, 320], [0, 700, 240], [0, 0, 1]]
    lens = {"K": K, "dist": [0.1, 0, 0, 0, 0], "image_size": [640, 480], "fisheye": False}
    return {"lens.json": json.dumps(lens).encode()}


def ros_lens() -> Files:
    """A lens as ROS writes it, to the reader of OpenCV's files."""
    info = {"image_width": 640, "image_height": 480, "camera_matrix": {"rows": 3, "cols": 3, "data": [700.0, 0, 320, 0, 700, 240, 0, 0, 1]},
            "distortion_model": "plumb_bob", "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.1, 0, 0, 0, 0]}}  # fmt: skip
    return {"lens.yaml": yaml.safe_dump(info).encode()}


def video(suffix: str) -> Files:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"film{suffix}"
        rng = np.random.default_rng(0)
        if suffix == ".avi":
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48))
            for _ in range(8):
                writer.write(rng.integers(0, 255, (48, 64, 3), dtype=np.uint8))
            writer.release()
        else:
            with VideoWriter(path, (64, 48), 10.0) as film:
                for _ in range(12):
                    film.write(np.full((48, 64, 3), rng.integers(0, 255), dtype=np.uint8))
        return {path.name: path.read_bytes()}


def picture(suffix: str) -> bytes:
    noise = np.random.default_rng(0).integers(0, 255, (40, 20, 3), dtype=np.uint8)
    return bytes(cv2.imencode(suffix, noise)[1].tobytes())


def network() -> bytes:
    """An ONNX file: mean colours of a crop, times a table."""
    from onnx import TensorProto, helper, numpy_helper

    nodes = [
        helper.make_node("GlobalAveragePool", ["crop"], ["mean"]), helper.make_node("Flatten", ["mean"], ["flat"], axis=1),
        helper.make_node("MatMul", ["flat", "weights"], ["embedding"]),
    ]  # fmt: skip
    ports = [helper.make_tensor_value_info("crop", TensorProto.FLOAT, ["n", 3, 32, 16])]
    outputs = [helper.make_tensor_value_info("embedding", TensorProto.FLOAT, ["n", 4])]
    weights = numpy_helper.from_array(np.eye(3, 4, dtype=np.float32), "weights")
    model = helper.make_model(
        helper.make_graph(nodes, "test", ports, outputs, [weights]), opset_imports=[helper.make_opsetid("", 17)], ir_version=8
    )
    helper.set_model_props(model, {"passerby.role": "embedder", "passerby.mean": "0.5, 0.5, 0.5"})
    return bytes(model.SerializeToString())


def matlab() -> Files:
    from scipy.io import savemat

    return {"cam1.mat": written("cam1.mat", lambda path: savemat(path, {"cam1": np.arange(12.0).reshape(3, 4) + 1}))}


def bare_network() -> bytes:
    """The same without a word about itself."""
    import onnx

    model = onnx.load_from_string(network())
    del model.metadata_props[:]
    return bytes(model.SerializeToString())
