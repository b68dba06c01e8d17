"""Local features: SIFT, SURF and ORB as dense descriptors and as keypoint matchers.

`local_features` makes a matcher of any of them; OpenCV and mahotas are loaded when one is opened.
"""
