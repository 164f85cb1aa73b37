%% begin
$header
%% space
C
C     Volumetric energy U(J3) and its two derivatives, in units of the
C     shear modulus; K is the ratio of bulk and shear modulus.
C
      SUBROUTINE KPDVOL(J3, K, U)
      USE, INTRINSIC :: IEEE_ARITHMETIC
      IMPLICIT NONE
      REAL*8 J3, K, U(3)
$volumetric
      END
%% law
C
C     Isochoric energy W(I1, I2) in units of the shear modulus, and its
C     derivatives W1, W2, W11, W12, W22.
C
      SUBROUTINE KPDISO(I1, I2, W)
      USE, INTRINSIC :: IEEE_ARITHMETIC
      IMPLICIT NONE
      REAL*8 I1, I2, W(6)
$isochoric
      END
%% network
C
C     Activation function of the hidden units, and two derivatives.
C
      SUBROUTINE KPDACT(X, A)
      USE, INTRINSIC :: IEEE_ARITHMETIC
      IMPLICIT NONE
      REAL*8 X, A(3)
$activation
      END
C
C     Sum of the hidden units at the features P and Q, and derivatives
C     by P, Q, PP, PQ, QQ. Columns of T: weights of both features, bias
C     and output weight of a unit.
C
      SUBROUTINE KPDNET(P, Q, Y)
      IMPLICIT NONE
      REAL*8 P, Q, Y(6), A(3), T(4,$n_units)
      INTEGER J, K
      SAVE T
$units
      Y = 0.D0
      DO K = 1, $n_units
        CALL KPDACT(T(1,K)*P + T(2,K)*Q + T(3,K), A)
        Y(1) = Y(1) + T(4,K)*A(1)
        Y(2) = Y(2) + T(4,K)*T(1,K)*A(2)
        Y(3) = Y(3) + T(4,K)*T(2,K)*A(2)
        Y(4) = Y(4) + T(4,K)*T(1,K)*T(1,K)*A(3)
        Y(5) = Y(5) + T(4,K)*T(1,K)*T(2,K)*A(3)
        Y(6) = Y(6) + T(4,K)*T(2,K)*T(2,K)*A(3)
      END DO
      END
%% isochoric network
C
C     Isochoric energy W(I1, I2) in units of the shear modulus, and its
C     derivatives W1, W2, W11, W12, W22.
C
      SUBROUTINE KPDISO(I1, I2, W)
      IMPLICIT NONE
      REAL*8 I1, I2, W(6), Y(6)
      CALL KPDNET(LOG(I1/3.D0), LOG(I2/3.D0), Y)
      W(1) = Y(1) - ($at_rest)
      W(2) = Y(2)/I1
      W(3) = Y(3)/I2
      W(4) = (Y(4) - Y(2))/(I1*I1)
      W(5) = Y(5)/(I1*I2)
      W(6) = (Y(6) - Y(3))/(I2*I2)
      END
%% invariants
C
C     W at isochoric log-stretches X, its derivatives G by X, and its
C     second derivatives H along the axes, at constant volume.
C
      SUBROUTINE KPDATS(X, ENERGY, G, H)
      IMPLICIT NONE
      REAL*8 X(3), ENERGY, G(3), H(3), S(3), W(6), I1, I2, D1, D2
      INTEGER I
      S = EXP(2.D0*X)
      I1 = SUM(S)
      I2 = SUM(1.D0/S)
      CALL KPDISO(I1, I2, W)
      ENERGY = W(1)
      DO I = 1, 3
        D1 = 2.D0*(S(I) - I1/3.D0)
        D2 = -2.D0*(1.D0/S(I) - I2/3.D0)
        G(I) = 2.D0*(W(2)*S(I) - W(3)/S(I))
        H(I) = (W(2)*(3.D0*S(I) + I1) + W(3)*(3.D0/S(I) + I2))*4.D0/9.D0
     &       + W(4)*D1*D1 + 2.D0*W(5)*D1*D2 + W(6)*D2*D2
      END DO
      END
%% stretches
C
C     A term of W at isochoric log-stretches X1, X2, X3 and the squares
C     S1, S2, S3 of the stretches: W, its derivatives by the former, and
C     its second derivative along axis 3.
C
      SUBROUTINE KPDTRM(X1, X2, X3, S1, S2, S3, C, W)
      USE, INTRINSIC :: IEEE_ARITHMETIC
      IMPLICIT NONE
      REAL*8 X1, X2, X3, S1, S2, S3, C($n_constants), W(5)
$term
      END
C
C     W at isochoric log-stretches X, its derivatives G by X, and its
C     second derivatives H along the axes, at constant volume. Columns
C     of T: constants of the terms.
C
      SUBROUTINE KPDATS(X, ENERGY, G, H)
      IMPLICIT NONE
      REAL*8 X(3), ENERGY, G(3), H(3), S(3), W(5), T($n_constants,$n_terms)
      INTEGER I, J, K, L, M
      SAVE T
$terms
      S = EXP(2.D0*X)
      ENERGY = 0.D0
      G = 0.D0
      H = 0.D0
      DO K = 1, $n_terms
        DO I = 1, 3
          L = MOD(I, 3) + 1
          M = MOD(I + 1, 3) + 1
          CALL KPDTRM(X(L), X(M), X(I), S(L), S(M), S(I), T(1,K), W)
          H(I) = H(I) + W(5)
        END DO
        ENERGY = ENERGY + W(1)
        G = G + W(2:4)
      END DO
      END
%% softening
C
C     Softening of W, its derivatives G and H along the axes, by the
C     factor eta of Ogden and Roxburgh; PEAK is the greatest W so far.
C     W becomes the stored energy.
C
      SUBROUTINE KPDSOF(PEAK, W, G, H)
      IMPLICIT NONE
      REAL*8 PEAK, W, G(3), H(3), WIDTH, Z, MOST, SLOPE, ROOT
      ROOT = SQRT(ACOS(-1.D0))
      PEAK = MAX(PEAK, W)
      WIDTH = $m + $beta*PEAK
      WIDTH = MAX(WIDTH, 1.D-300)
      Z = MIN((PEAK - W)/WIDTH, 1.D100)
      MOST = PEAK/WIDTH
      SLOPE = 0.D0
      IF (W .LT. PEAK) SLOPE = 2.D0*EXP(-Z*Z)/($r*WIDTH*ROOT)
      G = G - SUM(G)/3.D0
      H = (1.D0 - ERF(Z)/$r)*H + SLOPE*G*G
      G = (1.D0 - ERF(Z)/$r)*G
      W = W - (PEAK*ERF(MOST) - (PEAK - W)*ERF(Z)
     &  + WIDTH/ROOT*(EXP(-MOST*MOST) - EXP(-Z*Z)))/$r
      END
%% branches
C
C     Tensor I + S of the components 11, 22, 33, 12, 13, 23 of S.
C
      SUBROUTINE KPDTEN(S, A)
      IMPLICIT NONE
      REAL*8 S(6), A(3,3)
      A(1,:) = (/1.D0 + S(1), S(4), S(5)/)
      A(2,:) = (/S(4), 1.D0 + S(2), S(6)/)
      A(3,:) = (/S(5), S(6), 1.D0 + S(3)/)
      END
C
C     Components of A - I.
C
      SUBROUTINE KPDCOM(A, S)
      IMPLICIT NONE
      REAL*8 A(3,3), S(6)
      S = (/A(1,1) - 1.D0, A(2,2) - 1.D0, A(3,3) - 1.D0, A(1,2),
     &  A(1,3), A(2,3)/)
      END
C
C     Cofactor B of A.
C
      SUBROUTINE KPDCOF(A, B)
      IMPLICIT NONE
      REAL*8 A(3,3), B(3,3)
      INTEGER I, J, K, L, M, N
      DO I = 1, 3
        K = MOD(I, 3) + 1
        L = MOD(I + 1, 3) + 1
        DO J = 1, 3
          M = MOD(J, 3) + 1
          N = MOD(J + 1, 3) + 1
          B(I,J) = A(K,M)*A(L,N) - A(K,N)*A(L,M)
        END DO
      END DO
      END
C
C     Branches after a step of the duration DT, added to the energy, P
C     and A. STATE, of C_k and then Cb less I, is that of the beginning
C     and becomes that of the end. Columns of T: modulus over shear
C     modulus, and relaxation time of a branch. The equation C_k' = (Cb
C     - (Cb : C_k^-1)/3 C_k)/time is solved with the rate of the
C     beginning and Cb linear in time; the stress is that at fixed C_k.
C
      SUBROUTINE KPDBRA(F, DET, MU, DT, STATE, ENERGY, P, A)
      IMPLICIT NONE
      REAL*8 F(3,3), DET, MU, DT, STATE(*), ENERGY, P(3,3), A(3,3,3,3)
      REAL*8 T(2,$n_branches), C(3,3), CN(3,3), CK(3,3), D(3,3), M(3,3)
      REAL*8 Q(3,3), R(3,3), X(3,3), EYE(3,3), S, SQ, W, H, Y, B
      REAL*8 FIRST, LAST, ROOT, SHRINK
      INTEGER I, J, K, L, N
      SAVE T
$branches
      EYE = 0.D0
      DO I = 1, 3
        EYE(I,I) = 1.D0
      END DO
      SHRINK = DET**(-2.D0/3.D0)
      C = SHRINK*MATMUL(TRANSPOSE(F), F)
      CALL KPDCOF(F, D)
      D = D/DET
      CALL KPDTEN(STATE(6*$n_branches + 1), CN)
      CALL KPDCOM(C, STATE(6*$n_branches + 1))
      DO N = 1, $n_branches
        CALL KPDTEN(STATE(6*N - 5), CK)
        CALL KPDCOF(CK, M)
        H = MIN(DT/T(2,N), 1.D30)
        Y = H*SUM(CN*M)/3.D0
        IF (Y .LT. 0.01D0) THEN
          FIRST = 0.5D0 - Y*(1.D0/3.D0 - Y*(0.125D0 - Y*(1.D0/30.D0
     &      - Y/144.D0)))
          LAST = 0.5D0 - Y*(1.D0/6.D0 - Y*(1.D0/24.D0 - Y*(1.D0/120.D0
     &      - Y/720.D0)))
        ELSE
          FIRST = (1.D0 - (1.D0 + Y)*EXP(-Y))/Y**2
          LAST = (Y - 1.D0 + EXP(-Y))/Y**2
        END IF
        CK = EXP(-Y)*CK + H*FIRST*CN + H*LAST*C
        CALL KPDCOF(CK, M)
        ROOT = SUM(CK(1,:)*M(1,:))**(1.D0/3.D0)
        CALL KPDCOM(CK/ROOT, STATE(6*N - 5))
        M = M/ROOT**2
        B = SHRINK*H*LAST/ROOT
        W = MU*T(1,N)*SHRINK
        Q = MATMUL(F, M)
        R = MATMUL(Q, TRANSPOSE(F))
        S = R(1,1) + R(2,2) + R(3,3)
        SQ = SUM(R*R)
        X = 2.D0/3.D0*(B*(MATMUL(R, Q) - S/3.D0*Q) - Q)
        ENERGY = ENERGY + MU*T(1,N)/2.D0*(SHRINK*S - 3.D0)
        P = P + W*(Q - S/3.D0*D)
        S = S/3.D0
        DO L = 1, 3
          DO K = 1, 3
            DO J = 1, 3
              DO I = 1, 3
                A(I,J,K,L) = A(I,J,K,L) + W*(X(I,J)*D(K,L)
     &            + D(I,J)*X(K,L) + S*D(I,L)*D(K,J)
     &            + 2.D0/3.D0*(S + B*(S*S - SQ/3.D0))*D(I,J)*D(K,L)
     &            + (EYE(I,K) - B*R(I,K))*M(J,L)
     &            + B*(2.D0/3.D0*Q(I,J)*Q(K,L) - Q(I,L)*Q(K,J)))
              END DO
            END DO
          END DO
        END DO
      END DO
      END
%% space
C
C     Energy at log-stretches E, its derivatives T by E (principal
C     Kirchhoff stresses) and H, in units of the shear modulus.
C
      SUBROUTINE KPDPRI(E,$peak PROPS, ENERGY, T, H)
      IMPLICIT NONE
      REAL*8 E(3), PROPS(*), ENERGY, T(3), H(3,3)
%% softening
      REAL*8 PEAK
%% space
      REAL*8 G(3), D(3), U(3), VOLUME
      INTEGER I, J
      CALL KPDATS(E - SUM(E)/3.D0, ENERGY, G, D)
%% softening
      CALL KPDSOF(PEAK, ENERGY, G, D)
%% space
      VOLUME = EXP(SUM(E))
      CALL KPDVOL(VOLUME, PROPS(2)/PROPS(1), U)
      ENERGY = ENERGY + U(1)
      T = G - SUM(G)/3.D0 + VOLUME*U(2)
      DO I = 1, 3
        DO J = 1, 3
          H(I,J) = VOLUME*(U(2) + VOLUME*U(3))
          IF (I .EQ. J) THEN
            H(I,J) = H(I,J) + D(I)
          ELSE
            H(I,J) = H(I,J) + D(6-I-J) - SUM(D)/2.D0
          END IF
        END DO
      END DO
      END
%% sheet
C
C     Energy of the sheet at in-plane log-stretches E, its derivatives T
C     by E and H, in units of the shear modulus.
C
      SUBROUTINE KPDPRI(E, PROPS, ENERGY, T, H)
      IMPLICIT NONE
      REAL*8 E(2), PROPS(*), ENERGY, T(2), H(2,2), Y(6), TH, STEEP, FLAT
      CALL KPDNET(SUM(E), LOG(COSH(E(1) - E(2))), Y)
      FLAT = $flat
      ENERGY = Y(1) - ($at_rest) - FLAT*SUM(E)
      TH = TANH(E(1) - E(2))
      T(1) = Y(2) - FLAT + Y(3)*TH
      T(2) = Y(2) - FLAT - Y(3)*TH
      STEEP = Y(6)*TH*TH + Y(3)*(1.D0 - TH*TH)
      H(1,1) = Y(4) + 2.D0*Y(5)*TH + STEEP
      H(2,2) = Y(4) - 2.D0*Y(5)*TH + STEEP
      H(1,2) = Y(4) - STEEP
      H(2,1) = H(1,2)
      END
%% end
C
C     Log-stretches E, principal directions V (columns) and det F, by
C     Jacobi's method for the eigenvalues of F^T F.
C
      SUBROUTINE KPDJAC(F, E, V, DET)
      USE, INTRINSIC :: IEEE_ARITHMETIC
      IMPLICIT NONE
      REAL*8 F($d,$d), E($d), V($d,$d), DET
      REAL*8 C($d,$d), B($d), RATIO, T, CO, SI
      INTEGER I, J, L
      C = MATMUL(TRANSPOSE(F), F)
      V = 0.D0
      DO I = 1, $d
        V(I,I) = 1.D0
      END DO
      DO L = 1, 20
        DO I = 1, $d - 1
          DO J = I + 1, $d
            IF (ABS(C(I,J)) .GT. 1.D-17*SQRT(C(I,I)*C(J,J))) THEN
              RATIO = (C(J,J) - C(I,I))/(2.D0*C(I,J))
              T = SIGN(1.D0, RATIO)/(ABS(RATIO) + SQRT(1.D0+RATIO**2))
              CO = 1.D0/SQRT(1.D0 + T*T)
              SI = T*CO
              B = C(:,I)
              C(:,I) = CO*B - SI*C(:,J)
              C(:,J) = SI*B + CO*C(:,J)
              B = C(I,:)
              C(I,:) = CO*B - SI*C(J,:)
              C(J,:) = SI*B + CO*C(J,:)
              B = V(:,I)
              V(:,I) = CO*B - SI*V(:,J)
              V(:,J) = SI*B + CO*V(:,J)
            END IF
          END DO
        END DO
      END DO
      DO I = 1, $d
        E(I) = LOG(C(I,I))/2.D0
      END DO
%% space
      DET = F(1,1)*(F(2,2)*F(3,3) - F(2,3)*F(3,2))
     &    - F(1,2)*(F(2,1)*F(3,3) - F(2,3)*F(3,1))
     &    + F(1,3)*(F(2,1)*F(3,2) - F(2,2)*F(3,1))
%% sheet
      DET = F(1,1)*F(2,2) - F(1,2)*F(2,1)
%% end
C     There is no state unless det F > 0.
      IF (.NOT. DET .GT. 0.D0) E = IEEE_VALUE(1.D0, IEEE_QUIET_NAN)
      END
C
C     Energy density, first Piola-Kirchhoff stress P and tangent dP/dF.
%% memory
C     The state NEW at the end of a step of the duration DT follows OLD.
%% end
C
      SUBROUTINE KPDEVA(F,$past PROPS, ENERGY, P, A)
      IMPLICIT NONE
%% memory
      REAL*8 OLD($n_state), NEW($n_state), DT
%% end
      REAL*8 F($d,$d), PROPS(*), ENERGY, P($d,$d), A($d,$d,$d,$d)
      REAL*8 E($d), V($d,$d), N($d,$d), T($d), H($d,$d)
      REAL*8 S($d), DET, DIRECT, SLOPE, CROSS
      INTEGER I, J, K, L, M, O
      CALL KPDJAC(F, E, V, DET)
%% memory
      NEW = OLD
%% end
      CALL KPDPRI(E,$new_peak PROPS, ENERGY, T, H)
      ENERGY = PROPS(1)*ENERGY
      T = PROPS(1)*T
      H = PROPS(1)*H
      S = EXP(E)
      N = MATMUL(F, V)
      P = 0.D0
      A = 0.D0
      DO M = 1, $d
        N(:,M) = N(:,M)/S(M)
        DO J = 1, $d
          P(:,J) = P(:,J) + T(M)/S(M)*N(:,M)*V(J,M)
        END DO
      END DO
      DO M = 1, $d
        DO O = 1, $d
          DIRECT = H(M,O)/(S(M)*S(O))
          SLOPE = 0.D0
          CROSS = 0.D0
          IF (M .EQ. O) THEN
            DIRECT = DIRECT - T(M)/(S(M)*S(O))
          ELSE
C           Slope of the stress over the squared stretches, and its
C           limit for equal ones.
            IF (ABS(E(M) - E(O)) .GT. 1.D-5) THEN
              SLOPE = (T(M) - T(O))/(S(M)**2 - S(O)**2)
            ELSE
              SLOPE = (H(M,M)+H(O,O)-2.D0*H(M,O))/(4.D0*S(M)*S(O))
            END IF
            CROSS = (S(O)**2*SLOPE - T(O))/(S(M)*S(O))
          END IF
          DO L = 1, $d
            DO K = 1, $d
              DO J = 1, $d
                DO I = 1, $d
                  A(I,J,K,L) = A(I,J,K,L) + N(I,M)*(
     &              DIRECT*V(J,M)*N(K,O)*V(L,O)
     &              + SLOPE*V(J,O)*N(K,M)*V(L,O)
     &              + CROSS*V(J,O)*N(K,O)*V(L,M))
                END DO
              END DO
            END DO
          END DO
        END DO
      END DO
%% branches
      CALL KPDBRA(F, DET, PROPS(1), DT, NEW, ENERGY, P, A)
%% end
      END
%% space
C
C     Newton's method for the stretch F(3,3) of the thickness at which
C     the stress across a sheet vanishes (plane stress).
C
      SUBROUTINE KPDTHK(F,$past PROPS, ENERGY, P, A)
      IMPLICIT NONE
%% memory
      REAL*8 OLD($n_state), NEW($n_state), DT
%% space
      REAL*8 F(3,3), PROPS(*), ENERGY, P(3,3), A(3,3,3,3), STEP
      INTEGER I
      F(3,3) = 1.D0/(F(1,1)*F(2,2) - F(1,2)*F(2,1))
      DO I = 1, 50
        CALL KPDEVA(F,$past PROPS, ENERGY, P, A)
        STEP = MIN(MAX(P(3,3)/A(3,3,3,3), -F(3,3)), F(3,3)/2.D0)
        IF (ABS(STEP) .LE. 1.D-14*F(3,3)) EXIT
        F(3,3) = F(3,3) - STEP
      END DO
      END
%% umat memory
C
C     SSE is the stored energy; SPD and SCD stay as they are, so that
C     the energy dissipated is not accounted for.
C
%% umat
      SUBROUTINE UMAT(STRESS,STATEV,DDSDDE,SSE,SPD,SCD,RPL,DDSDDT,
     & DRPLDE,DRPLDT,STRAN,DSTRAN,TIME,DTIME,TEMP,DTEMP,PREDEF,DPRED,
     & CMNAME,NDI,NSHR,NTENS,NSTATV,PROPS,NPROPS,COORDS,DROT,PNEWDT,
     & CELENT,DFGRD0,DFGRD1,NOEL,NPT,LAYER,KSPT,JSTEP,KINC)
      USE, INTRINSIC :: IEEE_ARITHMETIC
      IMPLICIT NONE
      CHARACTER*80 CMNAME
      INTEGER NDI,NSHR,NTENS,NSTATV,NPROPS,NOEL,NPT,LAYER,KSPT,KINC
      INTEGER JSTEP(4)
      REAL*8 STRESS(NTENS),STATEV(NSTATV),DDSDDE(NTENS,NTENS),
     & DDSDDT(NTENS),DRPLDE(NTENS),STRAN(NTENS),DSTRAN(NTENS),TIME(2),
     & PREDEF(1),DPRED(1),PROPS(NPROPS),COORDS(3),DROT(3,3),
     & DFGRD0(3,3),DFGRD1(3,3),SSE,SPD,SCD,RPL,DRPLDT,DTIME,TEMP,
     & DTEMP,PNEWDT,CELENT
      REAL*8 F($d,$d),P($d,$d),A($d,$d,$d,$d),TAU($d,$d),B($d,$d,$d,$d)
      REAL*8 E($d),V($d,$d),FULL($voigt,$voigt),DET,EYE($d,$d)
      INTEGER I,J,K,L,M,N,II($voigt),JJ($voigt),AT($voigt)
%% umat memory
      REAL*8 OLD($n_state), NEW($n_state)
%% umat
%% umat space
      DATA II /1,2,3,1,1,2/, JJ /1,2,3,2,3,3/
%% umat memory
      IF (NSTATV .LT. $depvar) STOP '*Depvar must be at least $depvar'
      OLD = STATEV($first:$depvar)
%% umat space
      F = DFGRD1
C     In plane stress (11, 22, 12) the thickness is to be found.
      IF (NTENS .EQ. 3) THEN
        F(3,:) = 0.D0
        F(:,3) = 0.D0
        CALL KPDTHK(F,$statev PROPS, SSE, P, A)
      ELSE
        CALL KPDEVA(F,$statev PROPS, SSE, P, A)
      END IF
      CALL KPDJAC(F, E, V, DET)
%% umat sheet
      DATA II /1,2,1/, JJ /1,2,2/
      F = DFGRD1(1:2,1:2)
      CALL KPDEVA(F, PROPS, SSE, P, A)
C     The volume is that of the undeformed sheet.
      CALL KPDJAC(F, E, V, DET)
      DET = 1.D0
%% umat
      TAU = MATMUL(P, TRANSPOSE(F))
      EYE = 0.D0
      DO I = 1, $d
        EYE(I,I) = 1.D0
      END DO
C     Tangent of the Kirchhoff stress along F, pushed forward.
      B = 0.D0
      DO L = 1, $d
        DO K = 1, $d
          DO J = 1, $d
            DO I = 1, $d
              DO M = 1, $d
                DO N = 1, $d
                  B(I,J,K,L) = B(I,J,K,L) + F(J,M)*A(I,M,K,N)*F(L,N)
                END DO
              END DO
            END DO
          END DO
        END DO
      END DO
C     Tangent of the Jaumann rate of the Kirchhoff stress, over J.
      DO M = 1, $voigt
        DO N = 1, $voigt
          I = II(M)
          J = JJ(M)
          K = II(N)
          L = JJ(N)
          FULL(M,N) = (B(I,J,K,L) + B(I,J,L,K)
     &      + TAU(I,L)*EYE(J,K) + TAU(I,K)*EYE(J,L))/(2.D0*DET)
        END DO
      END DO
%% umat space
C     Components of the element: 11, 22, 33, 12, 13, 23 without those
C     that it lacks; in plane stress the one across is eliminated.
      AT = (/1, 2, 3, 4, 5, 6/)
      IF (NTENS .EQ. 3) THEN
        AT(3) = 4
        DO M = 1, 6
          IF (M .NE. 3) THEN
            FULL(M,:) = FULL(M,:) - FULL(M,3)/FULL(3,3)*FULL(3,:)
          END IF
        END DO
      END IF
%% umat sheet
      AT = (/1, 2, 3/)
%% umat
      DO M = 1, NTENS
        STRESS(M) = TAU(II(AT(M)),JJ(AT(M)))/DET
        DO N = 1, NTENS
          DDSDDE(M,N) = FULL(AT(M),AT(N))
        END DO
      END DO
%% umat memory
      STATEV($first:$depvar) = NEW
%% umat
C     Ask for a smaller increment where the material has no state.
      IF (IEEE_IS_NAN(SSE)) PNEWDT = 0.25D0
%% umat network
C     STATEV(1) is 1 outside the domain in which W was learned, else 0.
      IF (NSTATV .GE. 1) THEN
        STATEV(1) = 1.D0
%% umat isochoric network
        E = E - SUM(E)/3.D0
%% umat network
        E = EXP(E)
        IF (MINVAL(E) .GE. $least .AND.
     &      MAXVAL(E) .LE. $greatest) STATEV(1) = 0.D0
      END IF
%% umat
      END
%% calculix-umat
      SUBROUTINE UMAT_USER(AMAT,IEL,IINT,KODE,ELCONLOC,EMEC,EMEC0,
     & BETA,XOKL,VOJ,XKL,VJ,ITHERMAL,T1L,DTIME,TIME,TTIME,ICMD,IELAS,
     & MI,NSTATE_,XSTATEINI,XSTATE,STRE,STIFF,IORIEN,PGAUSS,ORAB,
     & PNEWDT,IPKON)
      USE, INTRINSIC :: IEEE_ARITHMETIC
      IMPLICIT NONE
      CHARACTER*80 AMAT
      INTEGER IEL,IINT,KODE,ITHERMAL(*),ICMD,IELAS,MI(*),NSTATE_,IORIEN
      INTEGER IPKON(*)
      REAL*8 ELCONLOC(*),EMEC(6),EMEC0(6),BETA(6),XOKL(3,3),VOJ,
     & XKL(3,3),VJ,T1L,DTIME,TIME,TTIME,XSTATEINI(NSTATE_,MI(1),*),
     & XSTATE(NSTATE_,MI(1),*),STRE(6),STIFF(21),PGAUSS(3),ORAB(7,*),
     & PNEWDT
      REAL*8 F(3,3),P(3,3),A(3,3,3,3),B(3,3,3,3),G(3,3),S(3,3),C(6)
      REAL*8 E(3),V(3,3),ENERGY,DET
      INTEGER I,J,K,L,M,N,II(6),JJ(6)
%% calculix-umat memory
      REAL*8 OLD($n_state), NEW($n_state)
%% calculix-umat
      DATA II /1,2,3,1,1,2/, JJ /1,2,3,2,3,3/
%% calculix-umat memory
      IF (NSTATE_ .LT. $depvar) STOP '*DEPVAR must be at least $depvar'
      OLD = XSTATEINI($first:$depvar,IINT,IEL)
%% calculix-umat
C     An F with F^T F = I + 2 EMEC, by Cholesky's method: no result
C     depends on the rotation, and EMEC has no thermal strain.
      C = 2.D0*EMEC
      C(1:3) = C(1:3) + 1.D0
      F = 0.D0
      F(1,1) = SQRT(C(1))
      F(1,2) = C(4)/F(1,1)
      F(1,3) = C(5)/F(1,1)
      F(2,2) = SQRT(C(2) - F(1,2)**2)
      F(2,3) = (C(6) - F(1,2)*F(1,3))/F(2,2)
      F(3,3) = SQRT(C(3) - F(1,3)**2 - F(2,3)**2)
      CALL KPDEVA(F,$statev ELCONLOC, ENERGY, P, A)
      CALL KPDJAC(F, E, V, DET)
C     Inverse G of F, second Piola-Kirchhoff stress S = G P, and its
C     derivative by Green's strain.
      G = 0.D0
      DO I = 1, 3
        G(I,I) = 1.D0/F(I,I)
      END DO
      G(1,2) = -F(1,2)*G(1,1)*G(2,2)
      G(2,3) = -F(2,3)*G(2,2)*G(3,3)
      G(1,3) = (F(1,2)*F(2,3) - F(1,3)*F(2,2))*G(1,1)*G(2,2)*G(3,3)
      S = MATMUL(G, P)
      DO M = 1, 6
        STRE(M) = S(II(M),JJ(M))
      END DO
      B = 0.D0
      DO L = 1, 3
        DO K = 1, 3
          DO J = 1, 3
            DO I = 1, 3
              DO M = 1, 3
                DO N = 1, 3
                  B(I,J,K,L) = B(I,J,K,L) + G(I,M)*A(M,J,N,L)*G(K,N)
                END DO
                B(I,J,K,L) = B(I,J,K,L) - G(I,M)*G(K,M)*S(L,J)
              END DO
            END DO
          END DO
        END DO
      END DO
      K = 0
      DO N = 1, 6
        DO M = 1, N
          K = K + 1
          STIFF(K) = (B(II(M),JJ(M),II(N),JJ(N))
     &      + B(II(M),JJ(M),JJ(N),II(N)))/2.D0
        END DO
      END DO
%% calculix-umat memory
      XSTATE($first:$depvar,IINT,IEL) = NEW
%% calculix-umat
C     Ask for a smaller increment where the material has no state.
      IF (IEEE_IS_NAN(ENERGY)) PNEWDT = 0.25D0
%% calculix-umat network
C     State variable 1 is 1 outside the domain of W, else 0.
      IF (NSTATE_ .GE. 1) THEN
        E = EXP(E - SUM(E)/3.D0)
        XSTATE(1,IINT,IEL) = 1.D0
        IF (MINVAL(E) .GE. $least .AND.
     &      MAXVAL(E) .LE. $greatest) XSTATE(1,IINT,IEL) = 0.D0
      END IF
%% calculix-umat
      END
