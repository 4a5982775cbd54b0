// Channel with a cylinder or a square, one cell thick: gmsh makes triangles, or quadrilaterals with layers around the obstacle,
// and extrudes them. Polyhedra are the dual of triangles: polyDualMesh makes them, extrudeMesh makes them one cell thick again.
// (Hexahedra come from snappyHexMesh, without this file.)
// @...@ are filled in by 'm4gn generate'. Lengths in metres.
L = 1.6;  H = 0.41;  T = 0.01;
x = @x@;  y = @y@;  r = @radius@;
quads = (@elements@ == 1);
dual = (@elements@ == 2);
// Edge length at the channel's ends: about as many quadrilaterals or polyhedra as triangles
h = @size@*(1 - 0.32*quads - 0.2*dual);

Point(1) = {0, 0, 0};  Point(2) = {L, 0, 0};  Point(3) = {L, H, 0};  Point(4) = {0, H, 0};
Line(1) = {1, 2};  Line(2) = {2, 3};  Line(3) = {3, 4};  Line(4) = {4, 1};
If (@shape@ == 0)
    Point(5) = {x, y, 0};
    Point(6) = {x + r, y, 0};  Point(7) = {x, y + r, 0};  Point(8) = {x - r, y, 0};  Point(9) = {x, y - r, 0};
    Circle(5) = {6, 5, 7};  Circle(6) = {7, 5, 8};  Circle(7) = {8, 5, 9};  Circle(8) = {9, 5, 6};
Else
    Point(6) = {x + r, y + r, 0};  Point(7) = {x - r, y + r, 0};  Point(8) = {x - r, y - r, 0};  Point(9) = {x + r, y - r, 0};
    Line(5) = {6, 7};  Line(6) = {7, 8};  Line(7) = {8, 9};  Line(8) = {9, 6};
EndIf
Curve Loop(1) = {1, 2, 3, 4};
Curve Loop(2) = {5, 6, 7, 8};
Plane Surface(1) = {1, 2};

// Fine at the cylinder, coarsening away from it
Field[1] = Distance;
Field[1].EdgesList = {5, 6, 7, 8};
Field[1].NNodesByEdge = 50;
Field[2] = Threshold;
Field[2].IField = 1;
Field[2].LcMin = 0.34*h;  Field[2].LcMax = h;
Field[2].DistMin = 0.25*r;  Field[2].DistMax = 0.25;
// Half as fine in the wake
Field[3] = Box;
Field[3].VIn = 0.7*h;  Field[3].VOut = h;
Field[3].XMin = x;  Field[3].XMax = x + 0.7;
Field[3].YMin = y - 2*r;  Field[3].YMax = y + 2*r;
Field[3].Thickness = 0.2;
Field[4] = Min;
Field[4].FieldsList = {2, 3};
Background Field = 4;
If (quads)
    Field[5] = BoundaryLayer;
    Field[5].EdgesList = {5, 6, 7, 8};
    Field[5].hwall_n = 0.1*h;  Field[5].ratio = 1.3;  Field[5].thickness = 0.6*h;
    Field[5].hfar = h;
    Field[5].Quads = 1;
    BoundaryLayer Field = 5;
    Mesh.RecombineAll = 1;
EndIf
Mesh.CharacteristicLengthFromPoints = 0;
Mesh.CharacteristicLengthExtendFromBoundary = 0;
Mesh.Algorithm = 6;
Mesh.Smoothing = 5;
Mesh.RandomSeed = 1;

volume[] = Extrude {0, 0, T} { Surface{1}; Layers{1}; Recombine; };
// volume[]: top, volume, then the side faces in the order of the curve loops
If (dual)
    // extrudeMesh starts from the bottom alone, which needs a patch for itself. It leaves the top out, whatever patch that is of.
    Physical Surface("frontAndBack") = {1};
    Physical Surface("outlet") = {volume[3], volume[0]};
Else
    Physical Surface("frontAndBack") = {1, volume[0]};
    Physical Surface("outlet") = {volume[3]};
EndIf
Physical Surface("walls") = {volume[2], volume[4]};
Physical Surface("inlet") = {volume[5]};
Physical Surface("cylinder") = {volume[6], volume[7], volume[8], volume[9]};
Physical Volume("fluid") = {volume[1]};
