"""A page in the browser: Meshcat's scene, and a panel of controls beside it."""

from arm_drake.visualization.page.page import Page as Page
from arm_drake.visualization.page.scene import Scene as Scene
from arm_drake.visualization.page.scene import WidgetEvent as WidgetEvent
from arm_drake.visualization.page.widgets import Button as Button
from arm_drake.visualization.page.widgets import Buttons as Buttons
from arm_drake.visualization.page.widgets import Choice as Choice
from arm_drake.visualization.page.widgets import Item as Item
from arm_drake.visualization.page.widgets import Picture as Picture
from arm_drake.visualization.page.widgets import Section as Section
from arm_drake.visualization.page.widgets import Slider as Slider
from arm_drake.visualization.page.widgets import Text as Text
from arm_drake.visualization.page.widgets import Toggle as Toggle
from arm_drake.visualization.page.widgets import Widget as Widget
