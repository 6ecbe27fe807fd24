"""Small inputs of each kind that are taken without a word, to be mutated."""

from tests import models

TAGS = """
  <gazebo reference="lower"><sensor name="imu" type="imu">
    <always_on>true</always_on><update_rate>100</update_rate>
    <plugin name="p" filename="libgazebo_ros_imu_sensor.so"><ros>
      <namespace>/a</namespace><remapping>~/out:=data</remapping></ros></plugin>
  </sensor></gazebo>
  <gazebo reference="upper"><mu1>0.2</mu1><selfCollide>true</selfCollide></gazebo>
  <gazebo><plugin name="gz_ros2_control" filename="libgz_ros2_control-system.so">
    <parameters>controllers.yaml</parameters></plugin></gazebo>"""

SHAPES = """
    <visual><origin xyz="0 0 0.1" rpy="0 0.1 0"/><geometry>
      <cylinder radius="0.1" length="0.3"/></geometry>
      <material name="red"><color rgba="1 0 0 1"/></material></visual>
    <visual><geometry><mesh filename="part.stl" scale="1 1 1"/></geometry></visual>
    <collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision>
  </link>"""

GRIPPER = """
  <link name="finger"><inertial><mass value="0.1"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>
  </inertial></link>
  <joint name="grip" type="prismatic"><parent link="lower"/><child link="finger"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.05" effort="10" velocity="1"/>
    <mimic joint="elbow" multiplier="0.01" offset="0.01"/>
    <safety_controller soft_lower_limit="0" soft_upper_limit="0.05" k_position="1"
      k_velocity="1"/></joint>
  <transmission name="t"><type>transmission_interface/SimpleTransmission</type>
    <joint name="elbow"/><actuator name="m">
      <mechanicalReduction>50</mechanicalReduction>
    </actuator></transmission>"""

URDF = models.TWO_LINKS.replace("</link>", SHAPES, 1).replace(
    "</robot>", f"{GRIPPER}{TAGS}</robot>"
)

XACRO = f"""<?xml version="1.0"?>
<robot name="two_links" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="size" default="0.5"/>
  <xacro:property name="size" value="$(arg size)"/>
  <xacro:property name="names" value="${{['a', 'b']}}"/>
  <xacro:macro name="leg" params="name parent:=base *origin size:=^|0.3 **block">
    <link name="${{name}}"><inertial><mass value="${{size * 2}}"/><inertia ixx="1e-3"
      ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
    <joint name="${{name}}_joint" type="revolute"><xacro:insert_block name="origin"/>
      <parent link="${{parent}}"/><child link="${{name}}"/><axis xyz="0 1 0"/>
      <limit lower="${{-pi}}" upper="${{radians(180)}}" effort="1" velocity="1"/>
    </joint>
    <xacro:insert_block name="block"/>
  </xacro:macro>
  <link name="base"/>
  <xacro:leg name="upper"><origin xyz="0 0 ${{size}}"/><block><link name="x"/>
    <joint name="xj" type="fixed"><parent link="upper"/><child link="x"/></joint>
  </block></xacro:leg>
  <xacro:if value="${{size > 0.2 and len(names) == 2}}">
    <xacro:leg name="lower" parent="upper"><origin xyz="0 0 0.2"/><block/></xacro:leg>
  </xacro:if>
  <xacro:unless value="false"/>
  {models.ros2_control("upper_joint", "lower_joint")}
</robot>"""

CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {type: joint_trajectory_controller/JointTrajectoryController}
    states: {type: joint_state_broadcaster/JointStateBroadcaster}
    group: {type: position_controllers/JointGroupPositionController}
    pid: {type: pid_controller/PidController}
arm:
  ros__parameters:
    joints: [shoulder, elbow]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
    constraints: {goal_time: 0.5, shoulder: {trajectory: 0.1, goal: 0.01}}
    gains: {shoulder: {p: 1.0, i: 0.0, d: 0.0}}
group: {ros__parameters: {joints: [shoulder]}}
pid:
  ros__parameters:
    dof_names: [elbow]
    command_interface: position
    reference_and_state_interfaces: [position]
    gains: {elbow: {p: 20.0, i: 20.0, i_clamp_max: 10.0, i_clamp_min: -10.0}}
/**: {ros__parameters: {use_sim_time: true}}
"""

BRIDGE = """
- ros_topic_name: /clock
  gz_topic_name: clock
  ros_type_name: rosgraph_msgs/msg/Clock
  gz_type_name: gz.msgs.Clock
  direction: GZ_TO_ROS
- {topic_name: /imu, ros_type_name: sensor_msgs/msg/Imu, gz_type_name: gz.msgs.IMU}
"""

SRDF = """<robot name="two_links">
  <group name="arm"><chain base_link="base" tip_link="lower"/>
    <joint name="elbow"/></group>
  <group_state name="up" group="arm"><joint name="shoulder" value="0.5"/>
    <joint name="elbow" value="0.1"/></group_state>
  <disable_collisions link1="upper" link2="lower" reason="Adjacent"/>
  <virtual_joint name="v" type="fixed" parent_frame="world" child_link="base"/>
  <end_effector name="e" parent_link="lower" group="arm"/>
</robot>"""

MOTION = """
parameters: {angle: 0.02}
steps:
- controller: arm
  trajectory:
    joint_names: [shoulder, elbow]
    points:
    - {positions: [0.0, 0.0], time_from_start: 0.005}
    - {positions: [0.01, $(angle)], time_from_start: 0.02}
- at: 0.02
  switch_controllers: {deactivate: [arm]}
"""

WORLD = """<sdf version="1.9"><world name="w">
  <gravity>0 0 -9.8</gravity>
  <scene><ambient>0.4 0.4 0.4 1</ambient><grid>true</grid></scene>
  <light type="directional" name="sun"><pose>0 0 10 0 0 0</pose>
    <direction>-0.5 0.1 -0.9</direction></light>
  <model name="ground"><static>true</static><link name="l"><collision name="c">
    <geometry><plane><normal>0 0 1</normal><size>9 9</size></plane></geometry>
    <surface><friction><ode><mu>0.5</mu><mu2>0.5</mu2></ode></friction></surface>
  </collision></link></model>
  <frame name="f"><pose>0 0 1 0 0 0</pose></frame>
  <model name="cube"><pose relative_to="f">2 0 0 0 0 0</pose><link name="l">
    <inertial><mass>0.1</mass><inertia><ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz>
      <ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial>
    <collision name="c"><geometry><box><size>.1 .1 .1</size></box></geometry>
    </collision>
    <visual name="v"><geometry><sphere><radius>0.1</radius></sphere></geometry>
      <material><diffuse>1 0 0 1</diffuse></material></visual></link>
    <joint name="j" type="revolute"><parent>world</parent><child>l</child>
      <axis><xyz>0 0 1</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis>
    </joint>
  </model>
  </world></sdf>"""

OBJ = """mtllib a.mtl
o cube
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
vn 0 0 1
vt 0 0
usemtl red
f 1/1/1 2/1/1 3/1/1
f 1 2 4
f 2 3 4
f 1 3 4
"""

_FACETS = "".join(
    f"facet normal 0 0 1\nouter loop\n{''.join(f'vertex {v}{chr(10)}' for v in t)}"
    "endloop\nendfacet\n"
    for t in (
        ("0 0 0", "1 0 0", "0 1 0"),
        ("0 0 0", "1 0 0", "0 0 1"),
        ("1 0 0", "0 1 0", "0 0 1"),
        ("0 0 0", "0 1 0", "0 0 1"),
    )
)

STL = f"solid a\n{_FACETS}endsolid a\n"

DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
  <library_effects><effect id="e"><profile_COMMON><technique sid="t"><phong><diffuse>
    <color>1 0 0 1</color></diffuse></phong></technique></profile_COMMON></effect>
  </library_effects>
  <library_materials><material id="m"><instance_effect url="#e"/></material>
  </library_materials>
  <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
      <technique_common><accessor source="#pa" count="4" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/>
        <param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="4" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
      <p>0 1 2 0 1 3 1 2 3 0 2 3</p></triangles></mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s"><node id="n">
    <matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix>
    <instance_geometry url="#g"><bind_material><technique_common>
      <instance_material symbol="m" target="#m"/></technique_common></bind_material>
    </instance_geometry></node></visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""
